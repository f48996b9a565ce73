use nalgebra::{Point3, Vector3};
use nelu3d::color_field::PixelQuality;
use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::frame::FieldFrame;
use nelu3d::color_field::published::{FieldCube, PublishedForm, PublishedOptions, PublishedSettings};
use nelu3d::progress::Progress;

const CELLS: [usize; 3] = [24, 20, 11];

/// A volume of 120 × 100 × 60 mm before the camera, in the camera's frame.
fn frame() -> FieldFrame {
    let mut frame = FieldFrame::around(Point3::origin(), Point3::new(0.0, 0.0, 600.0), Vector3::x());
    for corner in 0..8 {
        let at = |bit: i32, half: f64| if corner >> bit & 1 == 1 { half } else { -half };
        frame.enclose(&Point3::new(at(0, 60.0), at(1, 50.0), 600.0 + at(2, 30.0)));
    }
    frame
}

/// Fringes that drift with depth, as those of a projector beside the camera do.
fn expected(x: &Point3<f64>) -> [f32; 2] {
    [0.5 + 0.35 * (0.12 * x.x + 0.05 * x.z).sin(), 0.5 + 0.35 * (0.1 * x.y - 0.04 * x.z).cos()].map(|v| v as f32)
}

/// Samples of a sweep of `n_planes` boards.
fn sweep(frame: &FieldFrame, n_planes: usize) -> Bins {
    let mut bins = Bins::new([48, 40, 4 * n_planes], 2);
    for p in 0..n_planes {
        for i in 0..48 * 40 {
            let w = (p as f32 + 0.5) / n_planes as f32;
            let q = [((i % 48) as f32 + 0.5) / 48.0, ((i / 48) as f32 + 0.5) / 40.0, w];
            bins.add(q, &expected(&frame.from_unit(q.map(f64::from))), &[1.0; 2]);
        }
    }
    bins
}

fn options() -> PublishedOptions {
    PublishedOptions {
        levels: 8,
        log2_entries: 14,
        base_cells: 4,
        finest_cells: 32,
        units: 32,
        iterations: 800,
        batch: 1024,
        ..Default::default()
    }
}

fn trained(options: PublishedOptions, n_planes: usize) -> (PublishedForm, PixelQuality) {
    let frame = frame();
    let mut form = PublishedForm::new(PublishedSettings::new(CELLS, frame, options), 2, 3);
    let quality = form.train_and_compare(&sweep(&frame, n_planes), 3, &Progress::none()).unwrap();
    (form, quality)
}

/// PSNR over points anywhere in the volume, dB.
fn psnr_anywhere(form: &PublishedForm) -> f64 {
    let frame = frame();
    let at = |i: usize, step: f64| 0.05 + 0.9 * (i as f64 * step).fract();
    let points: Vec<_> =
        (0..4000).map(|i| frame.from_unit([at(i, 0.618_034), at(i, 0.754_878), at(i, 0.569_84)])).collect();
    let mut values = vec![0.0; 2 * points.len()];
    form.query(&points, &mut values);
    let square = |(v, t): (&f32, f32)| f64::from((v - t) * (v - t));
    let sum: f64 = values.iter().zip(points.iter().flat_map(expected)).map(square).sum();
    -10.0 * (sum / values.len() as f64).log10()
}

#[test]
fn the_cube_holds_the_volume_and_is_equally_fine_everywhere() {
    let (frame, cube) = (frame(), FieldCube::around(&frame()));
    for corner in 0..8 {
        let q = cube.to_unit(&frame.from_unit([0, 1, 2].map(|a| f64::from(corner >> a & 1))));
        assert!(q.iter().all(|q| (-1e-5..=1.0 + 1e-5).contains(q)), "{q:?}");
    }
    let at = Point3::new(3.0, -7.0, 590.0);
    let origin = cube.to_unit(&at);
    for axis in 0..3 {
        let mut moved = at;
        moved[axis] += 10.0;
        let step = cube.to_unit(&moved)[axis] - origin[axis];
        assert!((f64::from(step) * cube.side_mm - 10.0).abs() < 1e-3);
    }
    // A frustum is wider at its far end than the box of points that made it.
    assert!(cube.side_mm > 120.0 && cube.side_mm < 140.0, "{}", cube.side_mm);
}

#[test]
fn a_dense_sweep_is_learned_at_samples_that_were_held_out_and_between_boards() {
    let (form, quality) = trained(options(), 24);
    assert!(quality.psnr_db > 33.0 && quality.n > 500, "{quality:?}");
    let anywhere = psnr_anywhere(&form);
    assert!(anywhere > 30.0, "{anywhere}");
}

/// What the module says of itself: held-out samples do not show what happens between boards that are far apart, where
/// the finest cells are never supervised.
#[test]
fn a_sparse_sweep_is_known_at_its_boards_only() {
    let fine = PublishedOptions { finest_cells: 512, ..options() };
    let (form, quality) = trained(fine, 6);
    let anywhere = psnr_anywhere(&form);
    assert!(quality.psnr_db > anywhere + 3.0, "{} {anywhere}", quality.psnr_db);
}

#[test]
fn slopes_are_those_of_the_values() {
    let (form, _) = trained(PublishedOptions { iterations: 100, ..options() }, 6);
    let dir = Vector3::new(0.05, -0.02, 1.0).normalize();
    let points: Vec<_> = (0..50).map(|i| Point3::from(dir * (580.0 + 0.77 * f64::from(i)))).collect();
    let (mut values, mut slopes) = (vec![0.0; 100], vec![0.0; 100]);
    form.query_along(&points, &[dir; 50], &mut values, &mut slopes);
    const STEP: f64 = 0.01;
    let at = |away: f64| {
        let moved: Vec<_> = points.iter().map(|p| p + dir * away).collect();
        let mut out = vec![0.0; 100];
        form.query(&moved, &mut out);
        out
    };
    let (ahead, behind) = (at(STEP), at(-STEP));
    let largest = slopes.iter().fold(0.0f32, |m, s| m.max(s.abs()));
    // Linear between vertices and units: where one is crossed, a difference is neither slope.
    let differs = |i: &usize| {
        let difference = (ahead[*i] - behind[*i]) / (2.0 * STEP) as f32;
        (slopes[*i] - difference).abs() > 0.05 * largest
    };
    assert!(largest > 1e-3 && (0..100).filter(differs).count() <= 5);
    let mut same = vec![0.0; 100];
    form.query(&points, &mut same);
    assert!(values.iter().zip(&same).all(|(a, b)| (a - b).abs() < 1e-5));
}

#[test]
fn the_spline_passes_through_the_network_at_its_nodes() {
    let (form, _) = trained(PublishedOptions { iterations: 100, ..options() }, 6);
    let (grid, frame) = (form.to_grid(), frame());
    let (mut v, mut expected) = ([0.0; 2], [0.0; 2]);
    for (a, b, w) in (0..=24).flat_map(|a| (0..=20).step_by(5).flat_map(move |b| (0..=11).map(move |w| (a, b, w)))) {
        let q = [a as f32 / 24.0, b as f32 / 20.0, w as f32 / 11.0];
        grid.eval(q, &mut v);
        form.query(&[frame.from_unit(q.map(f64::from))], &mut expected);
        for (v, e) in v.iter().zip(expected) {
            assert!((v - e).abs() < 1e-4, "{q:?}: {v} {e}");
        }
    }
}

#[test]
fn the_published_size_is_49_megabytes() {
    let settings = PublishedSettings::new(CELLS, frame(), PublishedOptions::default());
    let form = PublishedForm::new(settings, 3, 0);
    let bytes = 4 * form.params().len();
    assert!((48_000_000..51_000_000).contains(&bytes), "{bytes}");
}

#[test]
fn sizes_that_make_no_field_are_refused() {
    assert!(PublishedOptions::default().check(3).is_ok());
    let backwards = PublishedOptions { finest_cells: 8, ..Default::default() };
    assert!(backwards.check(3).unwrap_err().to_string().contains("finest_resolution (8)"));
    let wide = PublishedOptions { levels: 32, features: 8, ..Default::default() };
    assert!(wide.check(3).unwrap_err().to_string().contains("n_inputs"));
}
