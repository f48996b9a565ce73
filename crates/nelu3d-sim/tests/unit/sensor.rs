use nelu3d_sim::Spec;
use nelu3d_sim::random::{RandomPurpose, generator};
use nelu3d_sim::sensor::Sensor;
use nelu3d_sim::spec::{CameraSpec, PerColor};

/// Mean and variance of codes, for light from black to nearly full, against the photon transfer curve:
/// variance = k² (electrons + read noise²) + 1/12, with k = gain · range / full well codes per electron.
#[test]
fn the_photon_transfer_curve_is_the_declared_one() {
    let plain = CameraSpec { black_level: 100.0, ..Spec::preset("demo").unwrap().camera };
    // All: a gain, an exposure, a dark current of 0, of some, of many electrons.
    for (place, (gain, exposure_secs, dark)) in
        [(1.0, 0.01, 0.0), (4.0, 0.002, 5e3), (16.0, 0.2, 1e3)].iter().enumerate()
    {
        let rates = [0.9, 1.0, 0.7].map(|v| v * plain.full_well_electrons / gain / exposure_secs);
        let camera = CameraSpec {
            gain: *gain,
            exposure_secs: *exposure_secs,
            dark_electrons_per_sec: *dark,
            electrons_per_sec: PerColor::Each(rates),
            ..plain.clone()
        };
        let sensor = Sensor::new(&camera);
        let range = camera.saturation() - camera.black_level;
        let k = gain * range / camera.full_well_electrons;
        let n = 20_000;
        for (i, light) in [0.0, 0.002, 0.05, 0.3, 0.6].into_iter().enumerate() {
            let channel = i % 3;
            let mut random = generator(1, RandomPurpose::Sensor, [i as u64, place as u64, 0]);
            let codes: Vec<f64> = (0..n).map(|_| f64::from(sensor.read(light, channel, &mut random)) * range).collect();
            let mean = codes.iter().sum::<f64>() / f64::from(n);
            let variance = codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / f64::from(n - 1);
            let electrons = (f64::from(light) * rates[channel] + dark) * exposure_secs;
            let expected = k * k * (electrons + camera.read_noise_electrons.powi(2)) + 1.0 / 12.0;
            // Five standard errors of a mean and of a variance.
            let error = 5.0 * (expected / f64::from(n)).sqrt();
            assert!((mean - k * electrons).abs() < error, "{light}: mean {mean}, not {}", k * electrons);
            let error = 5.0 * expected * (2.0 / f64::from(n)).sqrt() * (1.0 + 0.5 / electrons.max(1.0));
            assert!((variance - expected).abs() < error, "{light}: variance {variance}, not {expected}");
        }
    }
}

#[test]
fn codes_are_whole_and_end_at_saturation() {
    let camera = Spec::preset("demo").unwrap().camera;
    let sensor = Sensor::new(&camera);
    let mut random = generator(1, RandomPurpose::Sensor, [0, 0, 0]);
    for light in [0.0, 0.4, 1e6] {
        let code = f64::from(sensor.read(light, 0, &mut random)) * (camera.saturation() - camera.black_level);
        assert!((code - code.round()).abs() < 1e-3);
        if light > 1.0 {
            assert_eq!(code, camera.saturation() - camera.black_level);
        }
    }
    // A gain of 8 ends at an eighth of the well: 0.8 · 0.2 of it is beyond.
    let sensor = Sensor::new(&CameraSpec { gain: 8.0, ..camera.clone() });
    assert_eq!(sensor.read(0.2, 0, &mut random), 1.0);
}
