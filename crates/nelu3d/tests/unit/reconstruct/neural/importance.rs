use nalgebra::{Point3, Vector3};
use nelu3d::reconstruct::neural::bounds::Bounds;
use nelu3d::reconstruct::neural::config;
use nelu3d::reconstruct::neural::importance::place;
use nelu3d::reconstruct::neural::march::{March, step_mm};
use nelu3d::reconstruct::neural::start::Start;
use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};

#[test]
fn samples_gather_at_the_surface_and_cover_the_ray() {
    let mut settings = config::surface_config(Default::default(), 100);
    settings.field.encoding.log2_hashmap_size = 10;
    settings.sharpness = 0.4;
    let surface = Start::Plane.surface(settings, 1);
    let bounds = Bounds { center: Point3::new(0.0, 0.0, 600.0), unit_mm: 50.0 };
    let grid = OccupancyGrid::new(OccupancyConfig { resolution: 16, ..Default::default() }, |_| true);
    let dir = Vector3::new(0.01, 0.02, 1.0).normalize();
    let ray = |far| March { origin: Point3::origin(), dir, range: [540.0, far], offset: 0.5 };
    let short = 540.0 + 20.0 * step_mm(&bounds);
    let samples = place(&[ray(660.0), ray(short), ray(530.0)], &bounds, &grid, &surface, 64, 7);
    assert!((50..=64).contains(&samples.offsets[1]), "{:?}", samples.offsets);
    // A ray of fewer steps is marched, and one without any has none.
    assert_eq!((samples.offsets[2] - samples.offsets[1], samples.offsets[3] - samples.offsets[2]), (20, 0));
    let long = 0..samples.offsets[1];
    assert!(samples.t[long.clone()].is_sorted());
    // The intervals join, from one end of the ray to the other.
    let total: f32 = samples.lengths[long.clone()].iter().sum();
    assert!((total * 50.0 - 120.0).abs() < 2.0, "{total}");
    // The surface is softer than 1/exp(4) units = 0.9 mm; half of the samples lie within 6 mm of it.
    let near = samples.t[long.clone()].iter().filter(|t| (**t - 600.0).abs() < 6.0).count();
    assert!(near * 2 >= long.len(), "{near} of {}", long.len());
    let even = place(&[ray(660.0)], &bounds, &grid, &surface, 64, 7);
    assert_eq!(samples.t[long], even.t[..]);
}
