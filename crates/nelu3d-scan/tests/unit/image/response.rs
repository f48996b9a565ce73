use nelu3d_scan::image::Response;

#[test]
fn codes_of_srgb_become_light() {
    // Middle gray and the ends, by the standard's table.
    for (code, light) in [(0.0, 0.0), (0.04, 0.04 / 12.92), (128.0 / 255.0, 0.215_861), (0.5, 0.214_041)] {
        assert!((Response::Srgb.light(code) - light).abs() < 1e-5, "{code}");
    }
    assert_eq!((Response::Srgb.light(1.0), Response::Srgb.light(1.2)), (1.0, 1.2));
    assert_eq!(Response::Srgb.light(-0.02), -Response::Srgb.light(0.02));
}

#[test]
fn measured_curves_are_read_and_followed() {
    let curve = Response::from_json("r.json", br#"{"code": [0, 0.5, 1], "light": [0, 0.2, 1]}"#).unwrap();
    for (code, light) in [(0.25, 0.1), (0.5, 0.2), (0.75, 0.6), (1.0, 1.0), (-0.25, -0.1)] {
        assert!((curve.light(code) - light).abs() < 1e-12, "{code}");
    }
    assert_eq!(Response::from_json("r.json", curve.to_json().as_bytes()).unwrap(), curve);
    let srgb = Response::from_json("r.json", Response::Srgb.to_json().as_bytes()).unwrap();
    assert!(
        (0..=255)
            .all(|c| (srgb.light(f64::from(c) / 255.0) - Response::Srgb.light(f64::from(c) / 255.0)).abs() < 1e-12)
    );
    for (text, what) in [
        (r#"{"code": [0, 1], "light": [0, 0.5, 1]}"#, "2 codes and 3"),
        (r#"{"code": [0, 0.6, 0.5, 1], "light": [0, 0.1, 0.2, 1]}"#, "`code` does not rise"),
        (r#"{"code": [0, 1], "light": [0, 0.9]}"#, "`light` does not lead"),
        (r#"{"code": []}"#, "light"),
    ] {
        let e = Response::from_json("r.json", text.as_bytes()).unwrap_err();
        assert!(e.contains(what), "{text}: {e}");
    }
}
