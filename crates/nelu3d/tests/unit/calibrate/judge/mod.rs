mod corners;
mod field;
mod positions;
mod repeated;
mod repeats;
mod response;
mod scale;
mod wanted;

use nelu3d::calibrate::judge::{clipped, compressed, parts_left_out};
use nelu3d::sensor::BlockDetector;
use nelu3d::verdict::{Finding, Verdict};

#[test]
fn little_left_out_is_not_worth_a_word() {
    let excluded = [("000".into(), 0.05), ("001".into(), 0.3)];
    let notes: Vec<Finding> = parts_left_out(&excluded).collect();
    assert_eq!(notes.len(), 1);
    assert!(notes[0].verdict == Verdict::Good && notes[0].sentence.contains("30 % of board position 001"));
    assert!(clipped(0.1).is_none() && clipped(0.5).is_some());
    assert!(compressed(&BlockDetector::default()).is_none());
}
