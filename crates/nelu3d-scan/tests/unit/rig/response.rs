//! Cameras whose codes do not follow light evenly.

use nelu3d_scan::image::Response;
use nelu3d_scan::rig::{RIG_FILE, state_response};

use super::*;

/// An 8-bit rig with one image `file`, and what its rig.toml says of the response.
fn read(file: &str, bytes: &[u8], channels: Channels, response: Option<&str>) -> Result<Image, String> {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig { channels, black_level: 0.0, saturation: 255.0, board: None, ..rig_at(dir.path()) };
    rig.save().unwrap();
    fs::write(dir.path().join("curve.json"), r#"{"code": [0, 0.25, 1], "light": [0, 0.1, 1]}"#).unwrap();
    fs::write(dir.path().join(file), bytes).unwrap();
    if let Some(response) = response {
        let text = fs::read_to_string(dir.path().join(RIG_FILE)).unwrap();
        let text = text.replace("[camera]\n", &format!("[camera]\nresponse = \"{response}\"\n"));
        fs::write(dir.path().join(RIG_FILE), text).unwrap();
    }
    let opened = Rig::open(dir.path()).map_err(|e| e.to_string())?;
    // What was said is said again when the rig is saved.
    opened.save().unwrap();
    assert_eq!(Rig::open(dir.path()).unwrap(), opened);
    opened.read_image(&dir.path().join(file)).map_err(|e| e.to_string())
}

#[test]
fn codes_become_light_by_the_response_of_the_rig() {
    let gray = include_bytes!("gray128.jpg");
    let value = |response| read("a.jpg", gray, Channels::Mono, Some(response)).unwrap().data[7];
    assert!((value("linear") - 128.0 / 255.0).abs() < 1e-6);
    assert!((value("srgb") - 0.215_861).abs() < 1e-5);
    // On the line from (1/4, 1/10) to (1, 1).
    assert!((value("curve.json") - (0.1 + (128.0 / 255.0 - 0.25) * 1.2) as f32).abs() < 1e-5);
    let color = read("a.jpg", include_bytes!("color.jpg"), Channels::Rgb, Some("srgb")).unwrap();
    for (found, code) in color.data.iter().zip([200.0, 100.0, 50.0].into_iter().cycle()) {
        let light = |code: f64| Response::Srgb.light(code / 255.0) as f32;
        // JPEG is off by a code or two.
        assert!((light(code - 2.0)..=light(code + 2.0)).contains(found), "{found}, not {code}");
    }
}

#[test]
fn jpeg_files_of_unknown_response_are_refused() {
    let e = read("a.jpg", include_bytes!("gray128.jpg"), Channels::Mono, None).unwrap_err();
    assert!(e.contains("a.jpg") && e.contains("response = \"srgb\""), "{e}");
    for (response, what) in [("gamma", "cannot be read"), ("rig.toml", "camera.response"), ("", "camera.response")] {
        let e = read("a.jpg", include_bytes!("gray128.jpg"), Channels::Mono, Some(response)).unwrap_err();
        assert!(e.contains(what) && e.contains("\"srgb\""), "{response}: {e}");
    }
    // A damaged one is an error, not a picture.
    let half = &include_bytes!("color.jpg")[..200];
    let e = read("a.jpg", half, Channels::Rgb, Some("srgb")).unwrap_err();
    assert!(e.contains("a.jpg") && e.contains("truncated or damaged"), "{e}");
}

#[test]
fn a_measured_response_is_stated_and_the_rest_of_the_file_stays() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig { black_level: 0.0, saturation: 255.0, board: None, ..rig_at(dir.path()) };
    rig.save().unwrap();
    let file = dir.path().join(RIG_FILE);
    let text = fs::read_to_string(&file).unwrap().replace("[camera]\n", "# by hand\n[camera]  # mine\n");
    fs::write(&file, &text).unwrap();
    let table = Response::from_json("response.json", br#"{"code": [0, 0.25, 1], "light": [0, 0.1, 1]}"#).unwrap();
    for response in [table, Response::Srgb, Response::Linear] {
        state_response(dir.path(), &response).unwrap();
        assert_eq!(Rig::open(dir.path()).unwrap().response.as_ref(), Some(&response));
        let said = fs::read_to_string(&file).unwrap();
        let rest: Vec<&str> = said.lines().filter(|l| !l.starts_with("response = ")).collect();
        assert_eq!(rest, text.lines().collect::<Vec<_>>());
    }
    // Tables that are not in lines of their own are left to people.
    let inline = "format = 1\ncamera = { channels = \"mono\", black_level = 0.0, saturation = 255.0 }\n";
    fs::write(&file, inline).unwrap();
    let e = state_response(dir.path(), &Response::Srgb).unwrap_err().to_string();
    assert!(e.contains("rig.toml") && e.contains("by hand"), "{e}");
    assert_eq!(fs::read_to_string(&file).unwrap(), inline);
}
