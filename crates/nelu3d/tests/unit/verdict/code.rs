use nelu3d::verdict::Code;

/// What scripts rely on is documented.
#[test]
fn every_code_is_documented_once() {
    let document = include_str!("../../../../../docs/result-format.md");
    for code in Code::ALL {
        let row = format!("| `{}` |", code.name());
        assert_eq!(document.matches(&row).count(), 1, "{row} in docs/result-format.md");
    }
}
