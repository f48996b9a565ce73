use nelu3d::color_field::bins::Bins;
use nelu3d::color_field::hash::{HashForm, HashSettings, HashShape};
use nelu3d::progress::Progress;
use nelu3d_field::device::Device;

/// Fringes across, a slow change of their contrast along w.
fn expected(q: [f32; 3]) -> [f32; 2] {
    let contrast = 0.25 + 0.1 * q[2];
    [0.5 + contrast * (30.0 * q[0] + 4.0 * q[1]).sin(), 0.5 + contrast * (25.0 * q[1]).cos()]
}

const CELLS: [usize; 3] = [48, 40, 4];

/// Bins of samples on a lattice of planes of constant w, without those in `hole`.
fn bins(hole: std::ops::Range<f32>) -> Bins {
    let mut bins = Bins::new([CELLS[0], CELLS[1], 12], 2);
    for w in (0..24).map(|i| (i as f32 + 0.5) / 24.0).filter(|w| !hole.contains(w)) {
        for b in 0..80 {
            for a in 0..96 {
                let q = [(a as f32 + 0.5) / 96.0, (b as f32 + 0.5) / 80.0, w];
                bins.add(q, &expected(q), &[1.0; 2]);
            }
        }
    }
    bins
}

fn rmse(form: &HashForm, w: std::ops::Range<f32>) -> f32 {
    let grid = form.to_grid();
    let (mut sum, mut n, mut v) = (0.0, 0, [0.0; 2]);
    for i in 0..4000 {
        let unit = |step: f32| (i as f32 * step).fract();
        let q = [
            0.03 + 0.94 * unit(0.618_034),
            0.03 + 0.94 * unit(0.754_878),
            w.start + (w.end - w.start) * unit(0.569_84),
        ];
        grid.eval(q, &mut v);
        for (v, t) in v.iter().zip(expected(q)) {
            sum += (v - t) * (v - t);
            n += 1;
        }
    }
    (sum / n as f32).sqrt()
}

#[test]
fn it_interpolates_a_held_out_slab() {
    let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 3);
    form.train(&bins(0.4..0.6), 3, &Device::Cpu, &Progress::none());
    let error = rmse(&form, 0.4..0.6);
    // 40 dB, where the signal's own deviation from its mean is about 0.2.
    assert!(error < 0.01, "{error}");
}

/// Training on a GPU, if there is one, interpolates as well as on the CPU.
#[cfg(feature = "gpu")]
#[test]
fn it_interpolates_on_a_gpu_too() {
    use nelu3d_field::device::Choice;
    let Ok(gpu) = Device::open(Choice::Gpu) else {
        assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
        eprintln!("SKIPPED: the hash form on a GPU: no GPU and no software driver");
        return;
    };
    let settings = HashSettings { width: 16, n_levels: 4, batch: 512, ..HashSettings::for_cells([24, 20, 2]) };
    let error = |device: &Device| {
        let mut form = HashForm::new(settings.clone(), 2, 3);
        form.train(&bins(0.4..0.6), 3, device, &Progress::none());
        rmse(&form, 0.0..1.0)
    };
    let (gpu, cpu) = (error(&gpu), error(&Device::Cpu));
    assert!(gpu < 1.15 * cpu && cpu < 1.15 * gpu, "GPU {gpu}, CPU {cpu}");
}

#[test]
fn a_second_training_takes_up_what_is_new_and_keeps_the_rest() {
    let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 3);
    form.train(&bins(0.6..1.0), 3, &Device::Cpu, &Progress::none());
    let (known, unknown) = (rmse(&form, 0.05..0.4), rmse(&form, 0.85..1.0));
    let before = form.params().to_vec();
    form.train(&bins(0.0..0.0), 4, &Device::Cpu, &Progress::none());
    let (still_known, learned) = (rmse(&form, 0.05..0.4), rmse(&form, 0.85..1.0));
    let norm = |x: &mut dyn Iterator<Item = f32>| x.map(|x| x * x).sum::<f32>().sqrt();
    let change = norm(&mut before.iter().zip(form.params()).map(|(a, b)| a - b)) / norm(&mut before.iter().copied());
    assert!(known < 0.01 && still_known < 0.01, "{known} {still_known}");
    // Two fifths of the volume at once is far more than the positions held out of a sweep, and at its end.
    assert!(learned < 0.5 * unknown, "{unknown} {learned}");
    // Parameters drawn anew would be about as far away as they are large.
    assert!(change > 0.0 && change < 0.7, "{change}");
}

#[test]
fn the_spline_passes_through_the_network_at_its_nodes() {
    let mut form = HashForm::new(HashSettings { epochs: 1.0, ..HashSettings::for_cells(CELLS) }, 2, 5);
    form.train(&bins(0.0..0.0), 5, &Device::Cpu, &Progress::none());
    let grid = form.to_grid();
    let (mut v, mut expected) = ([0.0; 2], [0.0; 2]);
    for (a, b, w) in (0..=48).flat_map(|a| (0..=40).step_by(5).flat_map(move |b| (0..=4).map(move |w| (a, b, w)))) {
        let q = [a as f32 / 48.0, b as f32 / 40.0, w as f32 / 4.0];
        grid.eval(q, &mut v);
        form.network().query(&[q], &mut expected);
        for (v, e) in v.iter().zip(expected) {
            assert!((v - e).abs() < 1e-5, "{q:?}: {v} {e}");
        }
    }
}

#[test]
fn parameters_restore_the_form_and_nothing_else_does() {
    let form = HashForm::new(HashSettings::for_cells([20, 16, 1]), 3, 1);
    let again = HashForm::from_params(form.shape().clone(), form.params().to_vec()).unwrap();
    assert_eq!(form.to_grid(), again.to_grid());
    assert!(HashForm::from_params(form.shape().clone(), form.params()[1..].to_vec()).is_none());
    let shape = HashShape { k: 2, ..form.shape().clone() };
    assert!(HashForm::from_params(shape, form.params().to_vec()).is_none());
}

#[test]
fn no_samples_leave_it_as_it_is() {
    let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 1);
    let before = form.params().to_vec();
    form.train(&Bins::new([4, 4, 4], 2), 1, &Device::Cpu, &Progress::none());
    assert_eq!(before, form.params());
}
