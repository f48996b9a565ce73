use nelu3d_scan::pose::PoseError;

/// What a message says of positions and why they are not usable.
fn list(reasons: &[(String, String)]) -> String {
    let (usable, total) = (1, 1 + reasons.len());
    let e = PoseError::TooFewPositions { usable, total, reasons: reasons.to_vec() }.to_string();
    let start = format!("only 1 of {total} board positions are usable, and at least 3 are needed (");
    let end = "); show the whole board at more positions, and check that it is the one described in rig.toml";
    e.strip_prefix(&start).and_then(|e| e.strip_suffix(end)).unwrap_or_else(|| panic!("{e}")).to_owned()
}

#[test]
fn reasons_are_told_once() {
    let reasons = |all: &[(&str, &str)]| all.iter().map(|(p, r)| (p.to_string(), r.to_string())).collect::<Vec<_>>();
    assert_eq!(list(&reasons(&[("0", "dark")])), "0: dark");
    assert_eq!(list(&reasons(&[("0", "far"), ("1", "dark"), ("2", "dark")])), "1, 2: dark, 0: far");
    let many: Vec<_> =
        (0..9).map(|i| (i.to_string(), if i < 5 { "dark".into() } else { format!("odd {i}") })).collect();
    assert_eq!(list(&many), "0 to 4, 5 in all: dark, 5: odd 5, 6: odd 6, 2 more for other reasons");
}
