//! Is the exposure right?

use nelu3d_scan::image::{Raw, RawData};

/// What to do about the exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureVerdict {
    /// It uses most of the scale, and clips next to nothing.
    Good,
    /// Too much is clipped: shorten it.
    TooBright,
    /// It uses little of the scale: lengthen it, open the aperture, or raise the gain.
    TooDark,
    /// Nothing is lit by the light source.
    Unlit,
}

/// How the flash fills the camera's scale, over the pixels that the light source lights.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ExposureAdvice {
    /// What to do.
    pub verdict: ExposureVerdict,
    /// Part of the picture's values that the light source brightens by 2 % of the scale and more.
    pub lit: f64,
    /// Part of those that are clipped.
    pub clipped: f64,
    /// The value that 95 % of those stay below, as a part of the scale.
    pub used: f64,
    /// By what to multiply the exposure time, so that 95 % stay below four fifths of the scale.
    pub factor: f64,
}

/// Smallest white − black of a lit value, as a part of the scale: as `nelu3d check` has it.
const LIT: f64 = 0.02;
/// Largest part of lit values that may be clipped.
const MAX_CLIPPED: f64 = 0.02;
/// Smallest part of the scale that should be used.
const MIN_USED: f64 = 0.4;
/// Part of the scale to aim at.
const AIM: f64 = 0.8;

impl ExposureAdvice {
    /// Judges the flash. `black_level` and `saturation` are the camera's codes for no light and for clipped values.
    pub fn of(white: &Raw, black: &Raw, black_level: f64, saturation: f64) -> Self {
        let scale = (saturation - black_level).max(1.0);
        let (white, black) = (codes(white), codes(black));
        let mut lit: Vec<f64> = Vec::new();
        for (w, b) in white.iter().zip(&black) {
            if w - b >= LIT * scale || (*w >= saturation && *b < saturation) {
                lit.push((w - black_level) / scale);
            }
        }
        let part = lit.len() as f64 / white.len().max(1) as f64;
        if part < 0.01 {
            return Self { verdict: ExposureVerdict::Unlit, lit: part, clipped: 0.0, used: 0.0, factor: 1.0 };
        }
        let clipped = lit.iter().filter(|v| **v >= 1.0).count() as f64 / lit.len() as f64;
        let used = crate::noise::percentile(lit, 0.95).min(1.0);
        let verdict = match () {
            () if clipped > MAX_CLIPPED => ExposureVerdict::TooBright,
            () if used < MIN_USED => ExposureVerdict::TooDark,
            () => ExposureVerdict::Good,
        };
        let factor = match verdict {
            // How far beyond the scale clipped values lie is not known.
            ExposureVerdict::TooBright => 0.5,
            _ => AIM / used.max(0.01),
        };
        Self { verdict, lit: part, clipped, used, factor }
    }
}

impl std::fmt::Display for ExposureAdvice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |part: f64| 100.0 * part;
        match self.verdict {
            ExposureVerdict::Good => write!(f, "the exposure is good: {:.0} % of the scale used", percent(self.used)),
            ExposureVerdict::TooBright => write!(
                f,
                "{:.0} % of what the light source lights is clipped; halve the exposure time",
                percent(self.clipped)
            ),
            ExposureVerdict::TooDark => write!(
                f,
                "the flash uses {:.0} % of the camera's scale; {:.1} times the exposure time would be right",
                percent(self.used),
                self.factor
            ),
            ExposureVerdict::Unlit => write!(
                f,
                "the light source lights {:.1} % of the picture; point camera and light source at the same place",
                percent(self.lit)
            ),
        }
    }
}

fn codes(raw: &Raw) -> Vec<f64> {
    match &raw.data {
        RawData::U8(v) => v.iter().map(|c| f64::from(*c)).collect(),
        RawData::U16(v) => v.iter().map(|c| f64::from(*c)).collect(),
        RawData::Float(v) => v.iter().map(|c| f64::from(*c)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(codes: Vec<u8>) -> Raw {
        Raw { width: codes.len(), height: 1, channels: 1, data: RawData::U8(codes) }
    }

    #[test]
    fn exposures_are_judged_where_there_is_light() {
        let black = raw(vec![2; 100]);
        let judge = |lit: u8| {
            let white = raw((0..100).map(|i| if i < 40 { lit } else { 3 }).collect());
            ExposureAdvice::of(&white, &black, 0.0, 255.0)
        };
        let good = judge(204);
        assert_eq!((good.verdict, good.lit, good.clipped), (ExposureVerdict::Good, 0.4, 0.0));
        assert!((good.used - 0.8).abs() < 1e-9 && (good.factor - 1.0).abs() < 1e-9, "{good:?}");
        assert_eq!(judge(255).verdict, ExposureVerdict::TooBright);
        let dark = judge(51);
        assert_eq!(dark.verdict, ExposureVerdict::TooDark);
        assert!((dark.factor - 4.0).abs() < 1e-9 && dark.to_string().contains("4.0 times"), "{dark}");
        assert_eq!(judge(4).verdict, ExposureVerdict::Unlit);
    }
}
