use nelu3d::sensor::{PatternStatistics, edges, judge_patterns};
use nelu3d::verdict::Verdict;

const BITS: usize = 8;
const WIDTH: usize = 256;

/// The Gray code of the columns of `seen`, line by line over so many lines, and its edges along the lines.
fn gray(seen: std::ops::Range<usize>, lines: usize, edit: impl Fn(&mut [f32])) -> (PatternStatistics, Vec<[f64; 2]>) {
    let bit = |column: usize, j: usize| if (column ^ column >> 1) >> (BITS - 1 - j) & 1 == 1 { 0.97 } else { 0.02 };
    let mut line: Vec<f32> = seen.flat_map(|column| (0..BITS).map(move |j| bit(column, j))).collect();
    line.chunks_exact_mut(BITS).for_each(edit);
    let counts = edges(&line, BITS).into_iter().map(|n| [f64::from(n), 0.0]).collect();
    (PatternStatistics::new(&line.repeat(lines), BITS), counts)
}

/// What is said of a scene that shows some columns of the code.
fn judged(seen: std::ops::Range<usize>, edit: impl Fn(&mut [f32])) -> Option<(String, Verdict)> {
    let names: Vec<String> = (0..BITS).map(|j| format!("gray{j}")).collect();
    let ((scene, of_scene), (field, of_field)) = (gray(seen, 40, edit), gray(0..WIDTH, 4, |_| {}));
    let finding = judge_patterns((&scene, &of_scene), (&field, &of_field), &names)?;
    Some((finding.sentence, finding.verdict))
}

#[test]
fn edges_are_counted_within_stripes() {
    let line = [0.1, 0.5, 0.9, 0.8, f32::NAN, 0.1, 0.2, 0.9];
    assert_eq!(edges(&line, 1), [2]);
}

#[test]
fn a_scene_within_one_stripe_is_no_mistake() {
    for seen in [0..WIDTH, 60..200, 70..120, 96..130, 33..63] {
        assert_eq!(judged(seen.clone(), |_| {}), None, "{seen:?}");
    }
}

#[test]
fn white_in_the_place_of_a_pattern_is_told_by_the_edges_of_the_others() {
    let white = |j: usize| judged(40..216, move |codeword| codeword[j] = 0.99);
    for j in 3..BITS {
        let (sentence, verdict) = white(j).unwrap();
        assert!(sentence.starts_with(&format!("gray{j} is bright")), "{sentence}");
        assert_eq!(verdict, Verdict::Bad);
    }
    let dark = judged(40..216, |codeword| codeword[5] = 0.0).unwrap();
    assert!(dark.0.starts_with("gray5 is dark"), "{dark:?}");
}

#[test]
fn the_pattern_before_it_is_told_by_being_the_same() {
    let (sentence, verdict) = judged(40..216, |codeword| codeword[4] = codeword[3]).unwrap();
    assert_eq!((sentence.as_str(), verdict), ("gray4 shows what gray3 shows", Verdict::Bad));
}
