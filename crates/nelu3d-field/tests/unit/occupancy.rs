use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};

#[test]
fn finds_a_shell_and_follows_it() {
    let config = OccupancyConfig { resolution: 32, ..OccupancyConfig::default() };
    let mut grid = OccupancyGrid::new(config, |p| p[2] > 0.25);
    assert_eq!(grid.occupied_fraction(), 1.0);
    assert!(grid.is_occupied([0.5, 0.5, 0.3]) && !grid.is_occupied([0.5, 0.5, 0.2]));
    assert!(!grid.is_occupied([1.0, 0.5, 0.5]) && !grid.is_occupied([0.5, f32::NAN, 0.5]));
    let shell = |radius: f32| {
        move |points: &[[f32; 3]], alpha: &mut [f32]| {
            for (p, a) in points.iter().zip(alpha) {
                let r = p.iter().map(|x| (x - 0.5) * (x - 0.5)).sum::<f32>().sqrt();
                *a = if (r - radius).abs() < 0.05 { 0.5 } else { 0.0 };
            }
        }
    };
    grid.update(0, 1, shell(0.3));
    assert!(grid.occupied_fraction() > 0.05 && grid.occupied_fraction() < 0.5, "{}", grid.occupied_fraction());
    assert!(grid.is_occupied([0.8, 0.5, 0.5]) && !grid.is_occupied([0.5, 0.5, 0.5]));
    // No cell outside those that exist.
    assert!(!grid.is_occupied([0.5, 0.5, 0.2]));
    grid.update(1, 1, |_, _| panic!("it is not time"));
    // What was seen once is forgotten, slowly; what is new is found at random.
    for step in 1..200 {
        grid.update(256 + 16 * step, 1, shell(0.15));
    }
    assert!(grid.is_occupied([0.65, 0.5, 0.5]) && !grid.is_occupied([0.8, 0.5, 0.5]));
}
