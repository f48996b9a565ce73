use nelu3d::calibrate::position::PositionBuilder;
use nelu3d::calibrate::sweep::measured;
use nelu3d::calibrate::{CalibrationError, Position, Sweep};
use nelu3d::progress::Progress;
use nelu3d_scan::rig::PatternSet;
use nelu3d_scan::{Image, Rig};

#[test]
fn a_cell_has_one_measured_value_of_each_color() {
    let data = (0..4 * 2 * 3).map(|i| i as f32).collect();
    let half = measured(&Image { width: 4, height: 2, channels: 3, data }, [0, 1, 1, 2]);
    assert_eq!((half.width, half.height), (2, 1));
    // Red at (0, 0), green at (1, 0), blue at (1, 1) of each cell.
    assert_eq!(half.data, [0.0, 4.0, 17.0, 6.0, 10.0, 23.0]);
}

struct Silent;

impl nelu3d::progress::Sink for Silent {
    fn stage(&self, _: &str) {}
    fn tick(&self, _: usize, _: usize) {}
    fn warn(&self, _: &str) {}
}

/// A rig of `n` positions of 4 × 3 pixels whose pattern image holds the position's number.
fn rig(dir: &std::path::Path, n: usize) -> (Rig, PatternSet) {
    let set = PatternSet { name: "p".into(), images: vec!["p.png".into()], inverse: Vec::new() };
    for i in 0..n {
        let shot = dir.join("calibration").join(format!("{i:03}"));
        std::fs::create_dir_all(&shot).unwrap();
        for (name, value) in [("white.png", 0.5), ("black.png", 0.0), ("p.png", 0.005 * i as f32)] {
            let image = Image { width: 4, height: 3, channels: 1, data: vec![value; 12] };
            nelu3d_scan::image::write_png16(&shot.join(name), &image, 0.0, 2000.0).unwrap();
        }
    }
    let rig = Rig {
        root: dir.to_path_buf(),
        name: String::new(),
        camera: nelu3d_scan::Camera::pinhole(4, 3, 5.0, 5.0, 2.0, 1.5),
        camera_file: "camera.json".into(),
        channels: nelu3d_scan::image::Channels::Mono,
        response: None,
        black_level: 0.0,
        saturation: 2000.0,
        white: "white.png".into(),
        black: "black.png".into(),
        pattern_sets: vec![set.clone()],
        board: None,
        poses: Vec::new(),
        projector: None,
        memory: None,
    };
    (rig, set)
}

#[test]
fn positions_stream_in_order_a_few_at_a_time() {
    let dir = tempfile::tempdir().unwrap();
    let (rig, set) = rig(dir.path(), 23);
    let sweep = Sweep::new(&rig, &set, rig.positions().unwrap(), 0.02);
    let which: Vec<usize> = (0..23).filter(|i| i % 5 != 2).collect();
    let (mut received, mut largest) = (Vec::new(), 0);
    let map = |p: usize, images: usize, position: &Position| (p, images, position.values[7]);
    let take = |wave: Vec<_>| {
        largest = largest.max(wave.len());
        received.extend(wave);
    };
    sweep.stream(&which, &Progress::none(), |n: &mut usize, _| *n += 1, map, take).unwrap();
    assert!(largest <= 2 * rayon::current_num_threads(), "{largest}");
    assert_eq!(received.iter().map(|s| s.0).collect::<Vec<_>>(), which);
    // White and pattern were gathered; the values are the position's own.
    assert!(received.iter().all(|(p, images, v)| *images == 2 && (v - 0.01 * *p as f32).abs() < 1e-6));
}

/// The images of a large sensor are never whole in memory as light: what is made of them is the same, of mono patterns
/// among colored ones as well.
#[test]
fn blocks_of_a_large_sensor_are_those_of_its_whole_images() {
    const SIZE: (usize, usize) = (9, 601);
    let dir = tempfile::tempdir().unwrap();
    let (rig, _) = rig(dir.path(), 1);
    let images = ["mono.png".to_string(), "color.png".to_string(), "also-mono.png".to_string()];
    let set = PatternSet { name: "p".into(), images: images.to_vec(), inverse: Vec::new() };
    let camera = nelu3d_scan::Camera::pinhole(SIZE.0, SIZE.1, 5.0, 5.0, 4.0, 300.0);
    let rig = Rig { camera, channels: nelu3d_scan::image::Channels::Rgb, pattern_sets: vec![set.clone()], ..rig };
    let shot = rig.positions().unwrap().remove(0);
    let mut state = 1u32;
    let mut random = move |lo: f32, hi: f32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        lo + (hi - lo) * (state >> 8) as f32 / (1u32 << 24) as f32
    };
    let names = [&rig.white, &rig.black].into_iter().chain(&images);
    for (name, (lo, hi)) in names.zip([(0.4, 1.01), (0.0, 0.05), (0.05, 0.4), (0.05, 1.01), (0.05, 0.4)]) {
        let channels = if name.contains("mono") { 1 } else { 3 };
        let data = (0..SIZE.0 * SIZE.1 * channels).map(|_| random(lo, hi)).collect();
        let image = Image { width: SIZE.0, height: SIZE.1, channels, data };
        nelu3d_scan::image::write_png16(&shot.dir.join(name), &image, 0.0, 2000.0).unwrap();
    }

    let mut sweep = Sweep::new(&rig, &set, vec![shot.clone()], 0.02);
    sweep.binning = 2;
    let mut found = None;
    let map = |_: usize, rows: usize, position: &Position| (rows, position.values.clone(), position.contrast.clone());
    let gather = |rows: &mut usize, band: &Image| *rows += band.height;
    let mut stream = || {
        sweep.stream(&[0], &Progress::none(), gather, map, |mut wave| found = wave.pop()).unwrap();
        found.take().unwrap()
    };
    let (rows, values, contrast) = stream();
    // What was kept is given once, for the files: as good as these, but for its last bit.
    let (kept_rows, kept_values, kept_contrast) = stream();
    assert_eq!(kept_rows, 0);
    let is_near = |(a, b): (&f32, &f32)| (a - b).abs() < 5e-4;
    assert!(kept_values.len() == values.len() && kept_values.iter().zip(&values).all(is_near));
    assert!(kept_contrast.iter().zip(&contrast).all(|(a, b)| (*a == 0.0) == (*b == 0.0) && (a - b).abs() < 5e-5));
    assert_eq!(stream(), (rows, values.clone(), contrast.clone()));
    // White and the colored pattern are what the sensor measured.
    assert_eq!(rows, 2 * SIZE.1);
    assert_eq!(sweep.mono(), ["mono.png", "also-mono.png"]);

    let mut reader = rig.reader(&shot);
    let (white, black) = (reader.read(&rig.white).unwrap(), reader.read(&rig.black).unwrap());
    let mut whole = PositionBuilder::new(&white.binned(2), black.binned(2), 9, 0.02, None);
    for name in &images {
        whole.add(&reader.read_pattern(name, &white, Some(&black)).unwrap().0.binned(2));
    }
    let whole = whole.finish();
    assert_eq!((values.len(), contrast.len()), (4 * 300 * 9, 4 * 300 * 3));
    assert!(contrast.contains(&0.0) && contrast.iter().any(|c| *c > 0.0));
    assert_eq!((values, contrast), (whole.values, whole.contrast));
}

#[test]
fn gaps_are_named_before_work_is_done_and_stopping_stops() {
    let dir = tempfile::tempdir().unwrap();
    let (rig, set) = rig(dir.path(), 4);
    let sweep = Sweep::new(&rig, &set, rig.positions().unwrap(), 0.02);
    let names = sweep.map_white_black(&Progress::none(), |shot, _, _| shot.name.clone()).unwrap();
    assert_eq!(names, ["000", "001", "002", "003"]);
    let gap = dir.path().join("calibration/002/p.png");
    std::fs::remove_file(&gap).unwrap();
    let error = sweep.map_white_black(&Progress::none(), |_, _, _| ()).unwrap_err().to_string();
    assert!(error.contains(gap.to_str().unwrap()), "{error}");
    let error = sweep.stream(&[1, 2], &Progress::none(), |(), _| (), |_, (), _| (), |_| ()).unwrap_err().to_string();
    assert!(error.contains(gap.to_str().unwrap()), "{error}");
    let stop = Progress::new(std::sync::Arc::new(Silent), std::sync::Arc::new(true.into()));
    assert!(matches!(sweep.map_white_black(&stop, |_, _, _| ()), Err(CalibrationError::Cancelled)));
    let stopped = sweep.stream(&[0], &stop, |(), _| (), |_, (), _| (), |_| ());
    assert!(matches!(stopped, Err(CalibrationError::Cancelled)));
}
