use nalgebra::{Point3, Vector3};
use nelu3d_scan::Image;
use nelu3d_scan::image::write_png8;
use nelu3d_sim::scene::Albedo;
use nelu3d_sim::spec::{AlbedoSpec, AxisSpec};

fn of(spec: &AlbedoSpec) -> Albedo {
    Albedo::new(spec, &[]).unwrap()
}

#[test]
fn a_checker_changes_across_every_face() {
    let (from, to) = ([0.1; 3], [0.9; 3]);
    let checker = of(&AlbedoSpec::Checker { from, to, size_mm: 10.0 });
    for (p, expected) in [([1.0, 1.0, 1.0], 0.1), ([-1.0, 1.0, 1.0], 0.9), ([-1.0, -1.0, 1.0], 0.1)] {
        assert_eq!(checker.at(&Point3::from(p)), [expected; 3]);
    }
    assert_eq!(checker.at(&Point3::new(35.0, -15.0, 5.0)), [0.9; 3]);
}

#[test]
fn wood_has_rings_about_its_axis() {
    let spec = |seed| AlbedoSpec::Wood { from: [0.8; 3], to: [0.2; 3], ring_mm: 4.0, axis: AxisSpec::Y, seed };
    let wood = of(&spec(3));
    // Dark edges along a radius: about one per ring.
    let dark: Vec<bool> = (0..8000).map(|i| wood.at(&Point3::new(0.01 * f64::from(i), 1.0, 0.0))[0] < 0.45).collect();
    let rings = dark.windows(2).filter(|w| w[0] && !w[1]).count();
    assert!((16..=24).contains(&rings), "{rings}");
    // Nearly alike along the axis, and another tree for another seed.
    let change = |w: &Albedo, d: [f64; 3]| -> f32 {
        let value = |i: i32, s: f64| w.at(&(Point3::new(7.0 + f64::from(i), 0.0, 3.0) + Vector3::from(d) * s))[0];
        (0..50).map(|i| (value(i, 1.0) - value(i, 0.0)).abs()).sum()
    };
    assert!(change(&wood, [0.0, 1.0, 0.0]) < 0.3 * change(&wood, [1.0, 0.0, 0.0]));
    assert_ne!(of(&spec(4)).at(&Point3::new(9.0, 2.0, 1.0)), wood.at(&Point3::new(9.0, 2.0, 1.0)));
}

#[test]
fn a_picture_lies_where_it_should() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.png");
    // Bright at the top left, of a value whose linear light is known: sRGB 188 is 0.5029 of white.
    let mut image = Image::new(4, 2, 1);
    image.data[0] = 188.0 / 255.0;
    write_png8(&file, &image, 0.0, 255.0).unwrap();
    let spec = |axis, srgb| AlbedoSpec::Image { file: file.clone(), size_mm: [40.0, 20.0], axis, srgb };
    let z = of(&spec(AxisSpec::Z, true));
    assert!((z.at(&Point3::new(-15.0, -5.0, 99.0))[1] - 0.5029).abs() < 1e-3);
    assert!((z.at(&Point3::new(-10.0, -5.0, 0.0))[1] - 0.5029 / 2.0).abs() < 1e-3);
    assert_eq!(z.at(&Point3::new(-5.0, -5.0, 0.0)), [0.0; 3]);
    assert!((z.at(&Point3::new(-500.0, -50.0, 0.0))[1] - 0.5029).abs() < 1e-3, "beyond its border");
    let y = of(&spec(AxisSpec::Y, false));
    assert!((y.at(&Point3::new(-15.0, 77.0, -5.0))[0] - 188.0 / 255.0).abs() < 1e-3);
    let x = of(&spec(AxisSpec::X, false));
    assert!((x.at(&Point3::new(77.0, -5.0, -15.0))[0] - 188.0 / 255.0).abs() < 1e-3);
    assert!(
        Albedo::new(
            &AlbedoSpec::Image { file: "none.png".into(), size_mm: [1.0; 2], axis: AxisSpec::Z, srgb: true },
            &[]
        )
        .is_err()
    );
}
