use nelu3d::verdict::{Code, Finding, Judgment, Verdict};

#[test]
fn the_worst_finding_decides_and_comes_first() {
    let finding = |code, verdict| Finding::new(code, verdict, "it is so", "do that").with("n", 3);
    let mut j = Judgment::default();
    assert_eq!(j.line(), "good");
    j.add(finding(Code::DriftNotChecked, Verdict::Good));
    assert_eq!((j.verdict, j.warnings.len(), j.notes.len()), (Verdict::Good, 0, 1));
    j.extend([finding(Code::Clipped, Verdict::Doubtful), finding(Code::DepthRange, Verdict::Bad)]);
    j.add(finding(Code::CodeRepeats, Verdict::Doubtful));
    assert_eq!(j.line(), "bad (depth-range, clipped, code-repeats)");
    let json = serde_json::to_value(&j).unwrap();
    assert_eq!((&json["verdict"], &json["warnings"][0]["code"]), (&"bad".into(), &"depth-range".into()));
    assert_eq!(json["warnings"][1]["evidence"]["n"], 3);
    assert_eq!(j.warnings[0].to_string(), "it is so: do that [depth-range]");
}
