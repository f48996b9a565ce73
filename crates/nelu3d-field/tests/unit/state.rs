use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};
use nelu3d_field::state::TrainingState;
use nelu3d_field::surface::{NeuralSurface, SurfaceBatch, SurfaceConfig, SurfaceLoss};
use nelu3d_field::{HashField, HashFieldConfig};
use std::io;

fn saved(of: &dyn TrainingState) -> Vec<u8> {
    let mut bytes = Vec::new();
    of.save(&mut bytes).unwrap();
    bytes
}

/// Returns a surface whose network is weight normalized and whose sharpness is learned.
fn surface(seed: u64) -> NeuralSurface {
    let mut field = HashFieldConfig::<3> { append_position: true, ..HashFieldConfig::small(1) };
    field.training.weight_normalization = true;
    let loss = SurfaceLoss::default();
    let config = SurfaceConfig { field, extent: [2.0; 3], sharpness: 0.3, sharpness_learning_rate: 1e-3, loss };
    NeuralSurface::new(config, seed).unwrap()
}

fn train(surface: &mut NeuralSurface, n: usize) {
    let points: Vec<[f32; 3]> = (0..16).map(|i| [0.3, 0.4 + 0.01 * i as f32, i as f32 / 16.0]).collect();
    let colors: Vec<f32> = points.iter().map(|p| p[2]).collect();
    let batch = SurfaceBatch {
        offsets: &[0, 8, 16],
        points: &points,
        colors: &colors,
        measured: &[0.3, 0.6],
        white: &[1.0, 0.8],
        ambient: &[0.1, 0.0],
        mask: &[1.0, 1.0],
        intervals: None,
    };
    (0..n).for_each(|_| _ = surface.train_step(&batch, &mut []));
}

#[test]
fn a_surface_goes_on_where_it_was() {
    for before in [0, 5] {
        let mut whole = surface(1);
        train(&mut whole, before);
        let bytes = saved(&whole);
        let mut resumed = surface(2);
        // What it learned before is overwritten, its moments too.
        train(&mut resumed, 2);
        resumed.load(&mut &bytes[..]).unwrap();
        train(&mut whole, 3);
        train(&mut resumed, 3);
        assert_eq!(whole.field().n_steps(), before as u64 + 3);
        assert_eq!(saved(&whole), saved(&resumed));
        let mut without_moments = surface(2);
        train(&mut without_moments, before + 3);
        assert_ne!(saved(&whole), saved(&without_moments));
    }
}

#[test]
fn a_field_and_a_grid_go_on_where_they_were() {
    let config = HashFieldConfig::<2>::small(1);
    let mut whole = HashField::new(config.clone(), 1).unwrap();
    let points = [[0.1, 0.2], [0.7, 0.4]];
    let train = |field: &mut HashField<2>| (0..3).for_each(|_| _ = field.train_step(&points, &[1.0, -1.0], &[]));
    train(&mut whole);
    let mut resumed = HashField::new(config.clone(), 2).unwrap();
    resumed.load(&mut &saved(&whole)[..]).unwrap();
    train(&mut whole);
    train(&mut resumed);
    assert_eq!(saved(&whole), saved(&resumed));
    // Of another size, or not whole.
    let mut other = HashField::new(HashFieldConfig { width: 2 * config.width, ..config.clone() }, 1).unwrap();
    assert_eq!(other.load(&mut &saved(&whole)[..]).unwrap_err().kind(), io::ErrorKind::InvalidData);
    let bytes = saved(&whole);
    assert!(resumed.load(&mut &bytes[..bytes.len() - 1]).is_err());

    let config = OccupancyConfig { resolution: 8, every: 1, ..OccupancyConfig::default() };
    let grid = || OccupancyGrid::new(config, |p| p[0] > 0.3);
    let look = |grid: &mut OccupancyGrid, step| {
        grid.update(step, 7, |points, alpha| points.iter().zip(alpha).for_each(|(p, a)| *a = 0.01 * p[1]));
    };
    let (mut whole, mut resumed) = (grid(), grid());
    (0..300).for_each(|step| look(&mut whole, step));
    resumed.load(&mut &saved(&whole)[..]).unwrap();
    look(&mut whole, 300);
    look(&mut resumed, 300);
    assert_eq!(saved(&whole), saved(&resumed));
    let mut other = OccupancyGrid::new(OccupancyConfig { resolution: 4, ..config }, |_| true);
    assert!(other.load(&mut &saved(&whole)[..]).is_err());
}
