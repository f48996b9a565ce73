//! What the captures of a scene tell about themselves, before any depth is known: clipping, light that no pattern
//! modulates, patterns without light.

use nelu3d_scan::Image;
use nelu3d_scan::rig::Capture;

use super::measurements::Measurements;
use crate::surface::PixelStatus;
use crate::verdict::{Code, Finding, Verdict};

/// Most pixels that statistics look at.
const MAX_PIXELS: usize = 40_000;
/// Fewest lit pixels that tell something.
const MIN_PIXELS: usize = 200;
/// Normalized intensity from which a channel is as bright as white is.
const BRIGHT: f32 = 0.9;
/// Range of normalized intensities from which on a channel varies.
const VARIES: f32 = 0.5;
/// Normalized intensities that are neither dark nor bright.
const MID: std::ops::Range<f32> = 0.3..0.7;
/// Fraction of values in mid range below which a code is binary: 0.26 are in a sinusoid's, 0.4 in a triangle wave's,
/// and in a binary code's those of its edges.
const BINARY: f64 = 0.15;
/// Fewest patterns of a binary code.
const MIN_BITS: usize = 5;

/// Statistics of codewords: of a scene's pixels, or of what a field predicts along their rays.
#[derive(Clone, Debug, Default)]
pub struct CodewordStatistics {
    /// Number of codewords.
    pub n: usize,
    /// Fraction of the codewords that are about 1 in every channel.
    pub unmodulated: f64,
    /// Per channel, the quantiles at 2 % and 98 %.
    pub quantiles: Vec<[f32; 2]>,
    /// Fraction of the values that are neither dark nor bright, in the channels that are either somewhere.
    pub mid: f64,
}

impl CodewordStatistics {
    /// Makes the statistics of `n × k` values; NaN is not counted.
    pub fn new(codewords: &[f32], k: usize) -> Self {
        let n = codewords.len() / k.max(1);
        let unmodulated = codewords.chunks_exact(k.max(1)).filter(|c| c.iter().all(|v| *v > BRIGHT)).count();
        let quantiles = (0..k).map(|j| {
            let mut channel: Vec<f32> =
                codewords.iter().skip(j).step_by(k).copied().filter(|v| v.is_finite()).collect();
            channel.sort_by(f32::total_cmp);
            let at = |q: f64| channel.get((q * channel.len() as f64) as usize).copied().unwrap_or(f32::NAN);
            [at(0.02), at(0.98)]
        });
        let quantiles: Vec<[f32; 2]> = quantiles.collect();
        let varies = |j: usize| quantiles[j][1] - quantiles[j][0] > VARIES;
        let varying = || codewords.iter().enumerate().filter(|(i, v)| v.is_finite() && varies(i % k)).map(|(_, v)| v);
        let mid = varying().filter(|v| MID.contains(*v)).count() as f64 / varying().count().max(1) as f64;
        Self { n, unmodulated: unmodulated as f64 / n.max(1) as f64, quantiles, mid }
    }

    /// Makes the statistics of the lit pixels of a scene that are not clipped, and returns these pixels.
    pub fn of_scene(m: &Measurements, status: &[PixelStatus]) -> (Self, Vec<usize>) {
        let lit: Vec<usize> = (0..m.n()).filter(|i| status[*i].is_measured()).collect();
        let pixels: Vec<usize> = lit.iter().copied().step_by((lit.len() / MAX_PIXELS).max(1)).collect();
        let value = |j: usize| if m.inv_var[j] > 0.0 { m.p[j] } else { f32::NAN };
        let codewords: Vec<f32> = pixels.iter().flat_map(|i| (i * m.k..(i + 1) * m.k).map(value)).collect();
        (Self::new(&codewords, m.k), pixels)
    }
}

/// Judges how much of what is lit is clipped, by the status of every pixel.
pub fn judge_clipping(status: &[PixelStatus]) -> Option<Finding> {
    /// Highlights of glossy objects stay below this fraction.
    const MAX_CLIPPED: f64 = 0.15;
    let count = |s: PixelStatus| status.iter().filter(|v| **v == s).count();
    let (clipped, dark) = (count(PixelStatus::Saturated), count(PixelStatus::Underexposed));
    let lit = status.len() - dark;
    let share = clipped as f64 / lit.max(1) as f64;
    (lit >= MIN_PIXELS && share > MAX_CLIPPED).then(|| {
        let sentence = format!("{:.0} % of what is lit is clipped and has no depth", 100.0 * share);
        Finding::new(Code::Clipped, Verdict::Doubtful, sentence, "expose for less; matt spray takes highlights away")
            .with("clipped_share", share)
            .with("clipped_px", clipped)
    })
}

/// What a surface tells beside how much it covers.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurfaceEvidence {
    /// Fraction of the surface's pixels in pieces that end where the calibrated volume does, in the middle of what is
    /// lit.
    pub cut_by_volume: f64,
    /// Median χ² per measurement over the surface; `None` where that is not known.
    pub chi2: Option<f64>,
    /// What supports it beside its own fit; `None` where that is not known.
    pub support: Option<Support>,
}

impl SurfaceEvidence {
    /// Returns whether outlines and chance support the surface, and it fits as noise lets it.
    pub fn is_supported(&self) -> bool {
        /// Fraction of the surface up to which the rest supports it.
        const MAX_UNSUPPORTED: f64 = 0.25;
        /// Median χ² per measurement: right surfaces before a room had 0.99 at most, pieces of scenes whose patterns
        /// were swapped 1.4 and more.
        const MAX_CHI2: f64 = 1.2;
        self.support.is_some_and(|s| s.unsupported < MAX_UNSUPPORTED) && self.chi2.is_none_or(|chi2| chi2 < MAX_CHI2)
    }
}

/// What supports a surface beside its own fit, where much of the picture is explained nowhere in the calibrated volume.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Support {
    /// Fraction of the surface's pixels that nothing supports.
    pub unsupported: f64,
    /// Number of pixels without a depth that are explained before or behind the volume.
    pub elsewhere: usize,
}

/// Judges how much of what is lit was explained, with what the surface tells; `None` where there is no color field.
pub fn judge_explained(status: &[PixelStatus], surface: Option<SurfaceEvidence>) -> Option<Finding> {
    /// Fraction of the decoded pixels below which what is left may be chance. Those that are explained before or behind
    /// the volume do not count in the next two.
    const MIN_EXPLAINED: f64 = 0.6;
    /// Fraction of the decoded pixels that have to be explained where most of the surface ends by itself: a room around
    /// an object may be out of reach.
    const MIN_OF_WHOLE: f64 = 0.5;
    /// Fraction of the decoded pixels that have to be explained where outlines and chance support the surface: an object
    /// may be small before a room.
    const MIN_OF_SUPPORTED: f64 = 0.05;
    /// Fraction of the decoded pixels that have to be explained where most of the surface is cut by the volume's ends:
    /// of a mirrored scene up to 72 % is.
    const MIN_OF_CUT: f64 = 0.8;
    let count = |s: PixelStatus| status.iter().filter(|v| **v == s).count();
    let (valid, ambiguous) = (count(PixelStatus::Valid), count(PixelStatus::Ambiguous));
    let share = valid as f64 / (valid + ambiguous).max(1) as f64;
    tracing::debug!(share, valid, ambiguous, outside = count(PixelStatus::OutsideVolume), ?surface, "explained");
    let is_cut = surface.is_some_and(|s| s.cut_by_volume > 0.5);
    let support = surface.and_then(|s| s.support);
    let elsewhere = support.map_or(0, |s| s.elsewhere);
    let of_explained = valid as f64 / (valid + ambiguous - elsewhere.min(ambiguous)).max(1) as f64;
    let is_doubtful = match surface {
        None => share < MIN_EXPLAINED,
        Some(_) if is_cut => share < MIN_OF_CUT,
        Some(s) if s.is_supported() => of_explained < MIN_OF_SUPPORTED,
        Some(_) => of_explained < MIN_OF_WHOLE,
    };
    let is_noted = surface.is_some() && share < MIN_OF_WHOLE;
    (valid + ambiguous >= MIN_PIXELS && (is_doubtful || is_noted)).then(|| {
        let cut = if is_cut { ", and most of that ends where the volume does, not where an object does" } else { "" };
        let sentence = format!(
            "only {:.0} % of what is lit within the calibrated volume's rays has a depth that the field explains{cut}",
            100.0 * share
        );
        let (verdict, remedy) = if is_doubtful {
            let remedy = "place the object where the board was swept, and check that the images are this scene's, in \
                          the set's order";
            (Verdict::Doubtful, remedy)
        } else {
            (Verdict::Good, "what has none should be a room behind the object: look at the picture")
        };
        Finding::new(Code::LittleExplained, verdict, sentence, remedy)
            .with("explained_share", share)
            .with("cut_by_volume", surface.map(|s| s.cut_by_volume))
            .with("unsupported", support.map(|s| s.unsupported))
            .with("median_chi2", surface.and_then(|s| s.chi2))
            .with("valid_px", valid)
            .with("ambiguous_px", ambiguous)
            .with("elsewhere_px", support.map(|s| s.elsewhere))
    })
}

/// Judges a capture by itself, for methods without a color field. `status` is the status of every pixel after decoding,
/// `images` are the names of the patterns.
pub fn judge_capture(capture: &Capture, status: &[PixelStatus], images: &[String]) -> Vec<Finding> {
    let c = capture.white.channels;
    let lit: Vec<usize> = (0..status.len()).filter(|i| status[*i].is_measured()).collect();
    let pixels = lit.iter().step_by((lit.len() / MAX_PIXELS).max(1));
    let codeword = |i: &usize| {
        let own = i * c..(i + 1) * c;
        let normalized = |pattern: &Image, j: usize| {
            let black = capture.black.as_ref().map_or(0.0, |b| b.data[j]);
            (pattern.data[j] - black) / (capture.white.data[j] - black).max(1e-6)
        };
        let all: Vec<f32> = capture.patterns.iter().flat_map(|p| own.clone().map(move |j| normalized(p, j))).collect();
        all
    };
    let codewords: Vec<f32> = pixels.flat_map(codeword).collect();
    let statistics = CodewordStatistics::new(&codewords, c * capture.patterns.len());
    let mut findings: Vec<Finding> = judge_clipping(status).into_iter().collect();
    findings.extend(judge_codewords(&statistics, None, images));
    findings.extend(judge_explained(status, None));
    findings
}

/// Judges the codewords of a scene against what a field predicts along the same rays (any depth), or where there is no
/// field, against codes that use the whole range. `images` are the names of the patterns.
pub fn judge_codewords(
    scene: &CodewordStatistics,
    expected: Option<&CodewordStatistics>,
    images: &[String],
) -> Vec<Finding> {
    if scene.n < MIN_PIXELS {
        return Vec::new();
    }
    let mut findings: Vec<Finding> = unmodulated(scene, expected).into_iter().collect();
    findings.extend(without_light(scene, expected, images));
    findings
}

/// Much that is lit shows no pattern: light that is in white and patterns, but not in black.
fn unmodulated(scene: &CodewordStatistics, expected: Option<&CodewordStatistics>) -> Option<Finding> {
    /// Fraction of the lit pixels beyond what the field would give.
    const MAX_BEYOND: f64 = 0.2;
    // Without a field, the codes of a single picture may be bright everywhere.
    let usual = expected.map_or(0.2, |e| e.unmodulated);
    let share = scene.unmodulated;
    (share > 2.0 * usual + MAX_BEYOND).then(|| {
        let sentence = format!("{:.0} % of what is lit is as bright under every pattern as under white", 100.0 * share);
        let remedy = "light that is not the light source's was on while white and patterns were taken, but not in \
                  black: darken the room, and take the black image with the same light";
        Finding::new(Code::AmbientNotInBlack, Verdict::Doubtful, sentence, remedy).with("unmodulated_share", share)
    })
}

/// A pattern that is dark, or as bright as white, wherever something is lit.
fn without_light(
    scene: &CodewordStatistics,
    expected: Option<&CodewordStatistics>,
    images: &[String],
) -> Option<Finding> {
    /// Normalized intensity that counts as no light.
    const DARK: f32 = 0.15;
    let k = scene.quantiles.len();
    let wrong = |j: usize| {
        let [lo, hi] = scene.quantiles[j];
        let [expected_lo, expected_hi] = expected.map_or([0.0, 1.0], |e| e.quantiles[j]);
        if hi < DARK && expected_hi > VARIES {
            Some((j, "has no light", hi))
        } else if lo > 1.0 - DARK && expected_lo < 1.0 - VARIES {
            Some((j, "is as bright as white everywhere", lo))
        } else {
            None
        }
    };
    let (j, what, level) = (0..k).find_map(wrong)?;
    let image = images.get(j * images.len() / k).map_or("a pattern", String::as_str);
    // All of an object may stand within one stripe of a binary code's coarse patterns.
    let may_be_a_stripe = k >= MIN_BITS && scene.mid < BINARY;
    let within = "as within one stripe of a coarse binary pattern";
    let varies = "although the code of this set varies there";
    let (verdict, sentence) = match expected {
        Some(_) if may_be_a_stripe => (Verdict::Doubtful, format!("{image} {what}, {within}, {varies}")),
        Some(_) => (Verdict::Bad, format!("{image} {what}, {varies}")),
        None if may_be_a_stripe => (Verdict::Good, format!("{image} {what}, {within}")),
        None => (Verdict::Doubtful, format!("{image} {what}, although the other patterns vary there")),
    };
    let condition = if may_be_a_stripe { "if what is lit reaches over several stripes of this pattern, " } else { "" };
    let remedy = format!("{condition}take the scene again, and check the trigger");
    Some(Finding::new(Code::PatternWithoutLight, verdict, sentence, remedy).with("image", image).with("level", level))
}
