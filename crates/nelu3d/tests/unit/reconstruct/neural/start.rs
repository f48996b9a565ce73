use nelu3d::reconstruct::neural::start::Start;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

#[test]
fn a_surface_starts_with_its_shape() {
    for start in [Start::Plane, Start::Sphere] {
        let mut config = nelu3d::reconstruct::neural::config::surface_config(Default::default(), 100);
        config.field.encoding.log2_hashmap_size = 12;
        let surface = start.surface(config, 3);
        let distance = start.distance().expect("a shape");
        let mut rng = StdRng::seed_from_u64(9);
        let points: Vec<[f32; 3]> = (0..2000).map(|_| std::array::from_fn(|_| rng.random())).collect();
        let mut found = vec![0.0; points.len()];
        surface.field().query(&points, &mut found);
        let rms = points.iter().zip(&found).map(|(&p, f)| (distance(p) - f).powi(2)).sum::<f32>();
        let rms = (rms / points.len() as f32).sqrt();
        assert!(rms < 0.03, "{start:?}: {rms}");
    }
}
