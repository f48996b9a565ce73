use nelu3d::calibrate::smoothing::smoothness;
use nelu3d::calibrate::spline_fit::{Schedule, SplineFit};
use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::frame::Center;
use nelu3d::progress::Progress;

/// Stripes of a Gray code of twelve cells, a sample every second cell: in one half of the field with the weight of a
/// board's, in the other with that of carried ones. All schedules follow both.
#[test]
fn fine_stripes_are_as_deep_where_samples_weigh_little() {
    const CELLS: usize = 192;
    let stripe = |a: f32| 0.5 + 0.5 * (std::f32::consts::TAU * a * CELLS as f32 / 12.0).cos();
    let mut bins = Bins::new([CELLS, CELLS, 4], 1);
    let half = CELLS / 2;
    for i in 0..half * half {
        let at = [i % half, i / half].map(|v| (v as f32 + 0.5) / half as f32);
        let weight = if at[0] < 0.5 { 3000.0 } else { 30.0 };
        bins.add([at[0], at[1], 0.4], &[stripe(at[0])], &[weight]);
    }
    let smooth = smoothness(Center::Light, vec![[1.0, 1e4, 900.0]]);
    let depth = |schedule| {
        let grid = SplineFit::new(&bins, [CELLS, CELLS, 1], schedule).fit(&smooth, &Progress::none());
        let value = |a: f32| {
            let mut c = [0.0];
            grid.eval([a, 0.5, 0.4], &mut c);
            f64::from(c[0])
        };
        // Amplitude over that of the stripes, in the middle of either half.
        [0.25, 0.75].map(|middle: f32| {
            let at = |i: usize| middle + (i as f32 - 48.0) / (2 * CELLS) as f32;
            let sums = (0..96).map(|i| (value(at(i)) - 0.5) * f64::from(stripe(at(i)) - 0.5));
            sums.sum::<f64>() / (0..96).map(|i| f64::from(stripe(at(i)) - 0.5).powi(2)).sum::<f64>()
        })
    };
    let [few, many] = [true, false].map(|in_turn| Schedule::of(Center::Light, in_turn));
    for schedule in [few, few.anew(1), many] {
        let depths = depth(schedule);
        assert!(depths.iter().all(|depth| (depth - 1.0).abs() < 0.06), "{depths:?}");
    }
}

/// In the camera's frame codewords change along every axis, and every column has samples at depths of its own, as under
/// tilted boards. The field follows them.
#[test]
fn a_code_that_changes_along_the_rays_is_followed_in_the_camera_frame() {
    const CELLS: [usize; 3] = [64, 64, 23];
    const BOARDS: usize = 24;
    let code = |[a, b, w]: [f32; 3]| 0.5 + 0.5 * (std::f32::consts::TAU * (6.0 * a + b + 4.0 * w)).cos();
    let mut bins = Bins::new([64, 64, 92], 1);
    for i in 0..64 * 64 * BOARDS {
        let [a, b] = [i % 64, i / 64 % 64].map(|v| (v as f32 + 0.5) / 64.0);
        // Boards that are tilted by as much as they are apart.
        let p = (i / 64 / 64) as f32;
        let w = (p + 0.5 + 0.4 * (7.0 * a + 5.0 * b + 2.0 * p).sin()) / BOARDS as f32;
        bins.add([a, b, w], &[code([a, b, w])], &[1000.0]);
    }
    let smooth = smoothness(Center::Camera, vec![[30.0; 3]]);
    let fit = SplineFit::new(&bins, CELLS, Schedule::of(Center::Camera, false));
    let grid = fit.fit(&smooth, &Progress::none());
    let (mut squares, mut n) = (0.0, 0.0);
    for i in 0..20_000 {
        let q = [0.7549, 0.5698, 0.3247].map(|step: f32| 0.1 + 0.8 * (i as f32 * step).fract());
        let mut c = [0.0];
        grid.eval(q, &mut c);
        squares += (c[0] - code(q)).powi(2);
        n += 1.0;
    }
    let rms = (squares / n).sqrt();
    assert!(rms < 0.01, "{rms}");
}
