use std::fs::File;
use std::io::BufReader;

use nelu3d_scan::image::Apng;
use png::{ColorType, Decoder};

#[test]
fn frames_come_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let (w, h, n) = (13, 7, 4);
    let frame = |i: usize| (0..w * h * 3).map(|p| (p * 7 + i * 50) as u8).collect::<Vec<u8>>();
    for (fps, (num, den)) in [(25.0, (1, 25)), (29.97, (1000, 29970)), (0.5, (1000, 500)), (1057.3, (10, 10573))] {
        let mut apng = Apng::create(&path, w, h, n, fps).unwrap();
        for i in 0..n {
            apng.push(&frame(i)).unwrap();
        }
        apng.finish().unwrap();
        let mut reader = Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
        let control = reader.info().animation_control.unwrap();
        assert_eq!((control.num_frames, control.num_plays), (n as u32, 0));
        let mut pixels = vec![0; w * h * 3];
        for i in 0..n {
            let info = reader.next_frame(&mut pixels).unwrap();
            assert_eq!((info.width as usize, info.height as usize, info.color_type), (w, h, ColorType::Rgb));
            let shown = reader.info().frame_control.unwrap();
            assert_eq!((shown.delay_num, shown.delay_den), (num, den));
            assert_eq!(pixels, frame(i), "frame {i}");
        }
        assert!(reader.next_frame(&mut pixels).is_err());
    }
}

#[test]
fn half_a_film_is_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut apng = Apng::create(&path, 2, 2, 2, 10.0).unwrap();
    apng.push(&[0; 12]).unwrap();
    drop(apng);
    let mut apng = Apng::create(&path, 2, 2, 2, 10.0).unwrap();
    apng.push(&[0; 12]).unwrap();
    assert!(apng.finish().is_err());
    let mut apng = Apng::create(&path, 2, 2, 1, 10.0).unwrap();
    apng.push(&[0; 12]).unwrap();
    assert!(apng.push(&[0; 12]).is_err());
    drop(apng);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    let e = Apng::create(&dir.path().join("no/a.png"), 2, 2, 1, 10.0).unwrap_err().to_string();
    assert!(e.contains("no/a.png") && e.contains("create its folder"), "{e}");
}
