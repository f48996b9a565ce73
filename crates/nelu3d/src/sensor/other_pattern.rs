//! Whether an image of a scene shows another pattern than its own, as where a trigger was missed: that of an image before
//! it, or white. Codewords tell that by themselves, before any depth is known.

use crate::verdict::{Code, Finding, Verdict};

/// Fewest lit pixels that tell something.
const MIN_PIXELS: usize = 200;
/// Standard deviation of normalized intensities from which on a pattern varies.
const VARIES: f64 = 0.15;
/// Mean difference of two patterns, normalized intensity, from which on they differ.
const DIFFERENT: f64 = 0.15;
/// Difference up to which they are the same, and part of the one that they should have, and of what each varies by.
const SAME: [f64; 2] = [0.05, 0.3];
/// Difference of two values that noise hardly makes, and fraction of a scene's pixels that may have it where two
/// patterns are the same: two that are dark but for a corner may share that by chance, not to the pixel.
const UNLIKE: [f64; 2] = [0.25, 0.005];
/// Standard deviation of normalized intensities from which on a pattern's variation is more than noise.
const MORE_THAN_NOISE: f64 = 0.03;
/// Normalized intensities up to which a stripe is dark, and from which on it is bright.
const DARK_AND_BRIGHT: [f32; 2] = [0.3, 0.7];
/// Fraction of values between dark and bright below which a pattern has stripes: a sinusoid has 0.26, a triangle wave 0.4.
const BINARY: f64 = 0.3;
/// Fraction of a scene's values that are bright, or dark, where a pattern has one stripe.
const ONE_STRIPE: f64 = 0.98;
/// By how many times a code's edges are more often along the axis that it changes along than along the other one.
const ONE_AXIS: f64 = 3.0;
/// Numbers of edges from which on it is odd, and wrong, that there are none: within one stripe of a pattern there should
/// be less than one, and where two parts of a scene have one each, less than two.
const NO_EDGES: [f64; 2] = [1.5, 2.5];
/// Number of other patterns along the same axis that tell how much of the code a scene shows.
const MIN_OTHERS: usize = 3;

/// What is known of the patterns of a set: of a scene's pixels, or of what a field predicts along their rays.
#[derive(Clone, Debug, Default)]
pub struct PatternStatistics {
    /// Number of codewords.
    pub n: usize,
    /// Per channel, fraction of values that are dark, and that are bright.
    pub dark_and_bright: Vec<[f64; 2]>,
    /// Per channel, standard deviation of its values.
    pub spread: Vec<f64>,
    /// Mean absolute difference of every channel and every other one, `k × k`.
    pub apart: Vec<f64>,
    /// Fraction of the codewords whose values in two channels are unlike, `k × k`.
    pub unlike: Vec<f64>,
}

impl PatternStatistics {
    /// Makes the statistics of `n × k` values; NaN is not counted.
    pub fn new(codewords: &[f32], k: usize) -> Self {
        let mean = |of: &mut dyn Iterator<Item = f32>| {
            let (n, sum) = of.filter(|v| v.is_finite()).fold((0u32, 0.0), |(n, sum), v| (n + 1, sum + f64::from(v)));
            sum / f64::from(n.max(1))
        };
        let channel = |j: usize| codewords.iter().skip(j).step_by(k).copied();
        let share = |j: usize, is: &dyn Fn(f32) -> bool| {
            mean(&mut channel(j).map(|v| if v.is_finite() { f32::from(is(v)) } else { v }))
        };
        let [dark, bright] = DARK_AND_BRIGHT;
        let spread = |j: usize| {
            let average = mean(&mut channel(j)) as f32;
            mean(&mut channel(j).map(|v| (v - average).powi(2))).sqrt()
        };
        let (mut apart, mut unlike) = (vec![0.0; k * k], vec![0.0; k * k]);
        for (i, j) in (0..k).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let differences = || channel(i).zip(channel(j)).map(|(a, b)| (a - b).abs());
            let is_unlike = |d: f32| if d.is_finite() { f32::from(f64::from(d) > UNLIKE[0]) } else { d };
            apart[i * k + j] = mean(&mut differences());
            unlike[i * k + j] = mean(&mut differences().map(is_unlike));
            (apart[j * k + i], unlike[j * k + i]) = (apart[i * k + j], unlike[i * k + j]);
        }
        Self {
            n: codewords.len() / k.max(1),
            dark_and_bright: (0..k).map(|j| [share(j, &|v| v < dark), share(j, &|v| v > bright)]).collect(),
            spread: (0..k).map(spread).collect(),
            apart,
            unlike,
        }
    }

    /// Returns whether a channel has stripes.
    fn has_stripes(&self, j: usize) -> bool {
        let [dark, bright] = self.dark_and_bright[j];
        1.0 - dark - bright < BINARY
    }
}

/// Counts the edges between dark and bright of every channel along a line of `n × k` values; NaN ends a stripe.
pub fn edges(line: &[f32], k: usize) -> Vec<u32> {
    let [dark, bright] = DARK_AND_BRIGHT;
    let of_channel = |j: usize| {
        let (mut edges, mut last) = (0, None);
        for v in line.iter().skip(j).step_by(k) {
            let here = if v.is_nan() {
                last = None;
                continue;
            } else if *v > bright {
                true
            } else if *v < dark {
                false
            } else {
                continue;
            };
            edges += u32::from(last.is_some_and(|last| last != here));
            last = Some(here);
        }
        edges
    };
    (0..k).map(of_channel).collect()
}

/// Judges the patterns of a scene against what a field predicts along the same rays, at any depth. With them come, per
/// channel, the numbers of edges across the scene's image, row by row and column by column, and across the field, along
/// its two axes across the light. `images` are the names of the patterns, of `k / images` channels each.
pub fn judge_patterns(
    (scene, scene_edges): (&PatternStatistics, &[[f64; 2]]),
    (field, field_edges): (&PatternStatistics, &[[f64; 2]]),
    images: &[String],
) -> Option<Finding> {
    let k = scene_edges.len();
    if scene.n < MIN_PIXELS || field.n == 0 || images.len() < 2 {
        return None;
    }
    let image = |j: usize| j * images.len() / k;
    let finding = |j: usize, verdict: Verdict, sentence: String| {
        let remedy = "take the scene again, and check the trigger";
        Finding::new(Code::PatternDisagrees, verdict, sentence, remedy).with("image", images[image(j)].as_str())
    };
    let is_along = |j: usize, axis: usize| {
        field.has_stripes(j) && field.spread[j] > VARIES && field_edges[j][axis] > ONE_AXIS * field_edges[j][1 - axis]
    };
    let is_one_stripe = |j: &usize| scene.dark_and_bright[*j].iter().any(|share| *share > ONE_STRIPE);
    let varies = |j: &usize| scene.spread[*j] > MORE_THAN_NOISE;
    let of_same_color = |i: usize| (i + k / images.len()..k).step_by((k / images.len()).max(1));
    let is_same = |(i, j): &(usize, usize)| {
        let (is, should) = (scene.apart[i * k + j], field.apart[i * k + j]);
        let varies_by = scene.spread[*i].min(scene.spread[*j]);
        let most = SAME[0].min(SAME[1] * should.min(varies_by));
        // What is dark, or bright, all over may be so in several patterns, but not to the bit.
        let is_like = is < most && scene.unlike[i * k + j] < UNLIKE[1] && !is_one_stripe(i);
        image(*i) != image(*j) && should > DIFFERENT && (is_like || is == 0.0)
    };
    let mut pairs = (0..k).filter(varies).flat_map(|i| of_same_color(i).map(move |j| (i, j)));
    if let Some((i, j)) = pairs.find(is_same) {
        let sentence = format!("{} shows what {} shows", images[image(j)], images[image(i)]);
        return Some(finding(j, Verdict::Bad, sentence).with("same_as", images[image(i)].as_str()));
    }
    let shares = |axis: usize, way: usize| -> Vec<f64> {
        let of = |j: usize| scene_edges[j][way] / field_edges[j][axis];
        (0..k).filter(|j| is_along(*j, axis)).map(of).collect()
    };
    for axis in 0..2 {
        // The way across the image that crosses the stripes.
        let Some(mut of_code) = (0..2).map(|way| shares(axis, way)).max_by(|a, b| total(a).total_cmp(&total(b))) else {
            continue;
        };
        of_code.sort_unstable_by(f64::total_cmp);
        let share = of_code.get(of_code.len() / 2).copied().unwrap_or_default();
        for j in (0..k).filter(|j| is_along(*j, axis)).filter(is_one_stripe) {
            let should = share * field_edges[j][axis];
            if should > NO_EDGES[0] && of_code.len() > MIN_OTHERS {
                let bright = scene.dark_and_bright[j][1] > ONE_STRIPE;
                let sentence = format!(
                    "{} is {} wherever something is lit, although by the edges of the other patterns {should:.1} of its own \
                     should lie across that",
                    images[image(j)],
                    if bright { "bright" } else { "dark" },
                );
                let verdict = if should > NO_EDGES[1] { Verdict::Bad } else { Verdict::Doubtful };
                return Some(finding(j, verdict, sentence).with("edges", should));
            }
        }
    }
    None
}

fn total(values: &[f64]) -> f64 {
    values.iter().sum()
}
