use nelu3d::calibrate::smoothing::smoothness;
use nelu3d::calibrate::spline_fit::{OF_FEW, OF_MANY, SplineFit};
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
    for schedule in [OF_FEW, OF_FEW.anew(1), OF_MANY] {
        let depths = depth(schedule);
        assert!(depths.iter().all(|depth| (depth - 1.0).abs() < 0.06), "{depths:?}");
    }
}
