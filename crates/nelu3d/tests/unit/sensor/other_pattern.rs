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

#[test]
fn a_corner_that_two_patterns_share_is_no_mistake() {
    // One codeword in 20 is bright in both; one in 30 in the second alone, where noise makes one in 400 seem so.
    let scene = |alone: usize| {
        let codewords: Vec<f32> = (0..6000)
            .flat_map(|i| {
                let both = i % 20 == 0;
                [both, both || i % alone == 1, i % 2 == 0].map(|is_bright| if is_bright { 0.97 } else { 0.02 })
            })
            .collect();
        PatternStatistics::new(&codewords, 3)
    };
    let field = PatternStatistics::new(
        &(0..800).flat_map(|i| [1, 2, 4].map(|bit| f32::from(i & bit > 0))).collect::<Vec<_>>(),
        3,
    );
    let names = ["a", "b", "c"].map(String::from);
    let edges = vec![[0.0; 2]; 3];
    let told = |scene: &PatternStatistics| judge_patterns((scene, &edges), (&field, &edges), &names);
    assert!(told(&scene(30)).is_none());
    assert_eq!(told(&scene(400)).unwrap().sentence, "b shows what a shows");
}

#[test]
fn it_is_told_of_a_small_part_of_a_wave_too() {
    const WAVES: usize = 3;
    // `missed` is what the second wave's image in the place of the third has of noise.
    let codewords = |seen: std::ops::Range<usize>, missed: Option<f32>| -> Vec<f32> {
        let phase = |column: usize, j: usize| column as f32 / WIDTH as f32 + j as f32 / WAVES as f32;
        let wave = |column: usize, j: usize| 0.5 + 0.45 * (std::f32::consts::TAU * phase(column, j)).cos();
        let noise = |column: usize| if column.is_multiple_of(2) { 1.0 } else { -1.0 };
        let value = |column: usize, j: usize| match missed {
            Some(by) if j == 2 => wave(column, 1) + by * noise(column),
            _ => wave(column, j),
        };
        seen.flat_map(|column| (0..WAVES).map(move |j| (column, j))).map(|(column, j)| value(column, j)).collect()
    };
    let of = |codewords: Vec<f32>| (PatternStatistics::new(&codewords.repeat(40), WAVES), vec![[0.0; 2]; WAVES]);
    let names: Vec<String> = (0..WAVES).map(|j| format!("wave{j}")).collect();
    let (field, of_field) = of(codewords(0..WIDTH, None));
    let told = |first: usize, missed: Option<f32>| {
        let (scene, of_scene) = of(codewords(first..first + 20, missed));
        judge_patterns((&scene, &of_scene), (&field, &of_field), &names).map(|found| found.sentence)
    };
    // Two of the waves cross at 128.
    for first in [95, 108, 225] {
        assert_eq!(told(first, None), None, "{first}");
        assert_eq!(told(first, Some(0.01)).as_deref(), Some("wave2 shows what wave1 shows"), "{first}");
    }
    // Where the wave is dark all over, another one may be dark, too, but not to the bit.
    assert_eq!([None, Some(0.01)].map(|missed| told(65, missed)), [None, None]);
    assert_eq!(told(65, Some(0.0)).as_deref(), Some("wave2 shows what wave1 shows"));
}
