use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::frequency::{FrequencyForm, FrequencySettings, FrequencyShape, Octaves};
use nelu3d::progress::Progress;

const CELLS: [usize; 3] = [32, 24, 4];

fn expected(q: [f32; 3]) -> [f32; 2] {
    [0.5 + 0.3 * (12.0 * q[0] + 3.0 * q[1]).sin(), 0.5 + (0.2 + 0.1 * q[2]) * (10.0 * q[1]).cos()]
}

fn bins() -> Bins {
    let mut bins = Bins::new([CELLS[0], CELLS[1], 12], 2);
    for w in (0..12).map(|i| (i as f32 + 0.5) / 12.0).filter(|w| !(0.45..0.55).contains(w)) {
        for i in 0..96 * 72 {
            let q = [((i % 96) as f32 + 0.5) / 96.0, ((i / 96) as f32 + 0.5) / 72.0, w];
            bins.add(q, &expected(q), &[1.0; 2]);
        }
    }
    bins
}

#[test]
fn octaves_that_are_supervised_interpolate_a_held_out_slab() {
    let settings =
        FrequencySettings { steps: 2500, batch: 512, ..FrequencySettings::for_cells(CELLS, Octaves::Supervised) };
    assert_eq!(settings.config(2).n_frequencies, [5, 4, 2]);
    let mut form = FrequencyForm::new(settings, 2, 3);
    form.train(&bins(), 3, &Progress::none());
    let grid = form.to_grid();
    let (mut sum, mut v) = (0.0, [0.0; 2]);
    for i in 0..1000 {
        let at = |step: f32| 0.03 + 0.94 * (i as f32 * step).fract();
        let q = [at(0.618_034), at(0.754_878), 0.45 + 0.1 * at(0.569_84)];
        grid.eval(q, &mut v);
        sum += v.iter().zip(expected(q)).map(|(v, t)| (v - t) * (v - t)).sum::<f32>() / 2000.0;
    }
    // The signal's own deviation from its mean is about 0.2.
    assert!(sum.sqrt() < 0.03, "{}", sum.sqrt());
}

#[test]
fn parameters_restore_the_form_and_nothing_else_does() {
    let form = FrequencyForm::new(FrequencySettings::for_cells([6, 5, 1], Octaves::Paper), 3, 1);
    assert_eq!(form.shape().config.n_frequencies, [20; 3]);
    let again = FrequencyForm::from_params(form.shape().clone(), form.params().to_vec()).unwrap();
    assert_eq!(form.to_grid(), again.to_grid());
    assert!(FrequencyForm::from_params(form.shape().clone(), form.params()[1..].to_vec()).is_none());
    let shape = FrequencyShape { k: 2, ..form.shape().clone() };
    assert!(FrequencyForm::from_params(shape, form.params().to_vec()).is_none());
}
