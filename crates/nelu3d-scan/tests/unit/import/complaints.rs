//! Everything that can be wrong with a recording: named, with a remedy, and nothing left behind.

use super::dng::Dng;
use super::*;

/// The import fails, names `what` with `why`, and leaves no rig behind.
fn complaint(request: &ImportRequest, what: &str, why: &str) {
    let existed = request.rig.exists();
    let e = import(request).unwrap_err().to_string();
    assert!(e.contains(what) && e.contains(why) && e.contains(';'), "`{e}` should name {what} and say: {why}");
    assert_eq!(request.rig.exists(), existed, "{e}");
}

#[test]
fn frames_that_cannot_be_used() {
    let bad = |dng: Dng, why: &str| {
        let dir = dngs(4);
        fs::write(dir.path().join("frames/frame_000003.dng"), dng.bytes(&vec![7; dng.width * dng.height])).unwrap();
        complaint(&request(dir.path(), sequence("s")), "frame_000003.dng", why);
    };
    bad(chronos(W + 2, H), "is 12x6 pixels, but its intrinsics say 10x6");
    bad(Dng { compression: 7, ..chronos(W, H) }, "is compressed by JPEG (usually lossless)");
    bad(Dng { bits: 6, ..chronos(W, H) }, "has 6 bits a pixel");
    bad(Dng { photometric: 2, ..chronos(W, H) }, "is no raw image");
    bad(Dng { cfa: Some([0, 1, 2, 3]), ..chronos(W, H) }, "no Bayer pattern");
    bad(Dng { cfa: None, ..chronos(W, H) }, "no Bayer pattern");
    bad(Dng { cfa: Some([0, 1, 1, 2]), ..chronos(W, H) }, "states another color filter");
    bad(Dng { white: Some(1023), ..chronos(W, H) }, "white level than frame_000001.dng");
    bad(Dng { active: Some([0, 0, 9, 99]), ..chronos(W, H) }, "its active area");
    for (content, why) in [(&b""[..], "it is empty"), (b"II*\0", "truncated"), (b"GIF89a", "is neither PNG, TIFF")] {
        let dir = dngs(4);
        fs::write(dir.path().join("frames/frame_000003.dng"), content).unwrap();
        complaint(&request(dir.path(), sequence("s")), "frame_000003.dng", why);
    }
}

#[test]
fn frames_of_different_kinds() {
    let mono = |dir: &Path| ImportRequest { channels: Some(Channels::Mono), ..request(dir, sequence("s")) };
    let dir = tiffs(4);
    let bytes = Raw { width: W, height: H, channels: 1, data: RawData::U8(vec![7; W * H]) };
    write_codes(&bytes, &dir.path().join("frames/frame_000003.tiff")).unwrap();
    complaint(&mono(dir.path()), "frame_000003.tiff", "is 8-bit, but frame_000001.tiff is 16-bit");
    let color = Raw { width: W, height: H, channels: 3, data: RawData::U16(vec![7; 3 * W * H]) };
    write_codes(&color, &dir.path().join("frames/frame_000003.tiff")).unwrap();
    complaint(&mono(dir.path()), "frame_000003.tiff", "has 3 channels, but frame_000001.tiff has 1");
    fs::remove_file(dir.path().join("frames/frame_000003.tiff")).unwrap();
    write_codes(&bytes, &dir.path().join("frames/frame_000003.png")).unwrap();
    complaint(&mono(dir.path()), "frames", "has frames of two kinds");
}

#[test]
fn folders_without_the_right_frames() {
    let dir = dngs(7);
    let good = request(dir.path(), sequence("s"));
    complaint(
        &ImportRequest { frames: dir.path().join("nowhere"), ..good.clone() },
        "nowhere",
        "there is no such file",
    );
    fs::create_dir(dir.path().join("empty")).unwrap();
    complaint(&ImportRequest { frames: dir.path().join("empty"), ..good.clone() }, "empty", "has no frames");
    complaint(&ImportRequest { last: Some(9), ..good.clone() }, "frames", "has frames 1 to 7, not 1 to 9");
    complaint(&ImportRequest { first: Some(5), last: Some(4), ..good.clone() }, "frames", "not 5 to 4");
    complaint(&ImportRequest { last: Some(1), ..good.clone() }, "frames", "has 1 frames, but a group is 2");
    complaint(&ImportRequest { target: ImportTarget::Scene("x".into()), ..good.clone() }, "frames", "holds 3 groups");
    complaint(&ImportRequest { mean: true, ..good.clone() }, "frames", "a sequence of one frame");
    // A lost frame shifts all others; a lost group, here frames 3 and 4, does not.
    fs::remove_file(dir.path().join("frames/frame_000003.dng")).unwrap();
    complaint(&good, "frame_000004.dng", "follows frame_000002.dng: a frame is missing");
    fs::remove_file(dir.path().join("frames/frame_000004.dng")).unwrap();
    assert_eq!(import(&good).unwrap().groups, 2);
}

#[test]
fn orders_and_names_that_do_not_fit() {
    let dir = dngs(4);
    let good = request(dir.path(), sequence("s"));
    let order = |text: &str| ImportRequest { order: words(text), ..good.clone() };
    complaint(&ImportRequest { order: None, ..good.clone() }, "rig.toml", "give --order");
    complaint(&order("a/b,white"), "rig.toml", "which is no file name");
    complaint(&order("a,a,white"), "rig.toml", "names a.png twice");
    complaint(&order("skip"), "rig.toml", "names no image");
    complaint(&order("white,black"), "rig.toml", "names no pattern");
    for name in ["", "..", "a/b", ".hidden"] {
        complaint(&ImportRequest { target: sequence(name), ..good.clone() }, "sequences", "is no name of a folder");
    }
    let black = ImportRequest { black: Some(dir.path().join("frames")), ..order("pattern,white,black") };
    complaint(&black, "frames", "is for recordings without black");
    import(&good).unwrap();
    let old = ImportRequest { camera: None, target: sequence("t"), ..good };
    let unknown = ImportRequest { order: words("pattern,flash"), ..old.clone() };
    complaint(
        &unknown,
        "rig.toml",
        "has no image `flash`; --order takes skip and the rig's images: black, pattern, white",
    );
    complaint(&ImportRequest { set: Some("x".into()), ..old.clone() }, "rig.toml", "has no pattern set `x`");
    complaint(&ImportRequest { saturation: Some(9.0), ..old.clone() }, "rig.toml", "--saturation is for new rigs only");
    complaint(&ImportRequest { camera: Some("c.json".into()), ..old }, "rig.toml", "--camera is for new rigs only");
}

#[test]
fn new_rigs_that_lack_something() {
    let dir = tiffs(4);
    let good = request(dir.path(), sequence("s"));
    complaint(&good, "frame_000001.tiff", "give --channels mono");
    complaint(&ImportRequest { camera: None, ..good.clone() }, "rig", "give them with --camera");
    let none = ImportRequest { camera: Some(dir.path().join("no.json")), ..good.clone() };
    complaint(&none, "no.json", "there is no such file");
    let mono = ImportRequest { channels: Some(Channels::Mono), ..good };
    let levels = ImportRequest { black_level: Some(50.0), saturation: Some(50.0), ..mono.clone() };
    complaint(&levels, "frames", "a saturation of 50 with a black level of 50");
    complaint(&ImportRequest { channels: Some(Channels::Rgb), ..mono.clone() }, "frame_000001.tiff", "has one channel");
    fs::create_dir(&mono.rig).unwrap();
    write_camera(&mono.rig.join("camera.json"), &Camera::pinhole(W, H, 21.0, 20.0, 4.5, 2.5)).unwrap();
    complaint(&mono, "rig/camera.json", "--camera is another file");
    // Its own is good enough.
    import(&ImportRequest { camera: None, ..mono.clone() }).unwrap();
    assert_eq!(Rig::open(&mono.rig).unwrap().camera.width, W);
}

#[test]
fn frames_of_another_camera_than_the_rigs() {
    let gray = tiffs(2);
    let mono = ImportRequest { channels: Some(Channels::Mono), ..request(gray.path(), sequence("s")) };
    import(&mono).unwrap();
    let old = ImportRequest { channels: None, camera: None, target: sequence("t"), ..mono };
    let bayer = dngs(2);
    let other = ImportRequest { frames: bayer.path().join("frames"), ..old.clone() };
    complaint(&other, "frame_000001.dng", "is \"bayer-grbg\", but rig.toml says camera.channels = \"mono\"");
    let rgb = recording(2, "png", |path, i| write_rgb8(path, W, H, &[i as u8; 3 * W * H]).unwrap());
    let other = ImportRequest { frames: rgb.path().join("frames"), ..old.clone() };
    complaint(&other, "frame_000001.png", "has three channels");
    let bytes = Raw { width: W, height: H, channels: 1, data: RawData::U8(vec![7; W * H]) };
    let small = recording(2, "png", |path, _| write_codes(&bytes, path).unwrap());
    let other = ImportRequest { frames: small.path().join("frames"), ..old };
    complaint(&other, "frame_000001.png", "never reaches the saturation");
}

#[test]
fn a_stopped_import_leaves_nothing() {
    let dir = dngs(8);
    let e = run(&request(dir.path(), sequence("s")), &|done, _| done < 3).unwrap_err();
    assert!(matches!(e, ImportError::Stopped), "{e}");
    assert!(!dir.path().join("rig").exists());
}
