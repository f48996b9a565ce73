use nelu3d_baselines::code::{AxisCode, Line};
use nelu3d_baselines::gray::GrayTable;
use nelu3d_scan::pattern::{Axis, Gray, Pattern, PatternImage};
use nelu3d_scan::rig::PatternSet;

fn gray_code(n: usize) -> AxisCode {
    let images = Pattern::Gray(Gray { axis: Axis::X, inverse: false }).generate(n, 1).unwrap().images;
    let line =
        |(image, p): (usize, PatternImage)| Line { image, channel: 0, path: "p.png".into(), values: p.image.data };
    AxisCode { axis: Axis::X, lines: images.into_iter().enumerate().map(line).collect() }
}

fn set() -> PatternSet {
    PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() }
}

#[test]
fn every_column_has_its_codeword() {
    let code = gray_code(600);
    let table = GrayTable::new(&code, &set()).unwrap();
    for u in 0..600u16 {
        assert_eq!(table.get(table.words[usize::from(u)]), Some([u, u]));
    }
    // Without the finest bit, pairs of columns share one.
    let mut coarse = code.clone();
    coarse.lines.pop();
    let table = GrayTable::new(&coarse, &set()).unwrap();
    assert_eq!(table.get(table.words[101]), Some([100, 101]));
    // Without the coarsest, distant columns do.
    let mut ambiguous = code;
    ambiguous.lines.remove(0);
    let error = GrayTable::new(&ambiguous, &set()).err().unwrap().to_string();
    assert!(error.contains("same codeword"), "{error}");
}
