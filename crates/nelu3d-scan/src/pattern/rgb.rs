//! Three patterns at once, as the color channels of one image.

use serde::{Deserialize, Serialize};

use super::{Pattern, PatternError};
use crate::image::Image;

/// Three patterns as red, green and blue. A color camera sees all of them in one capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rgb {
    /// The patterns in red, green and blue; each makes the same number of images.
    pub parts: [Box<Pattern>; 3],
}

impl Rgb {
    pub(super) fn generate(&self, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
        let mut parts = Vec::new();
        for part in &self.parts {
            parts.push(part.images(width, height)?[0].clone());
        }
        let counts = [parts[0].len(), parts[1].len(), parts[2].len()];
        let mono = parts.iter().flatten().all(|i| i.channels == 1);
        if !mono || counts[0] != counts[1] || counts[0] != counts[2] {
            return Err(PatternError::Parts { counts });
        }
        let interleave = |i: usize| {
            let data = (0..width * height).flat_map(|p| [0, 1, 2].map(|c| parts[c][i].data[p])).collect();
            Image { width, height, channels: 3, data }
        };
        Ok((0..counts[0]).map(interleave).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Gray, Ramp, Sinusoid};
    use super::*;

    #[test]
    fn channels_are_the_parts() {
        let part = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 2 });
        let parts = [part(8.0), part(9.0), part(11.0)];
        let rgb = Rgb { parts: parts.clone().map(Box::new) }.generate(30, 4).unwrap();
        assert_eq!(rgb.len(), 2);
        for (c, part) in parts.iter().enumerate() {
            for (image, expected) in rgb.iter().zip(part.generate(30, 4).unwrap().images) {
                let channel: Vec<f32> = image.data.iter().skip(c).step_by(3).copied().collect();
                assert_eq!(channel, expected.image.data);
            }
        }
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let ramp = || Box::new(Pattern::Ramp(Ramp::default()));
        let gray = Box::new(Pattern::Gray(Gray::default()));
        let error = Rgb { parts: [ramp(), ramp(), gray] }.generate(16, 4).unwrap_err();
        assert_eq!(error, PatternError::Parts { counts: [1, 1, 4] });
        let nested = Box::new(Pattern::Rgb(Rgb { parts: [ramp(), ramp(), ramp()] }));
        assert!(Rgb { parts: [ramp(), ramp(), nested] }.generate(16, 4).is_err());
    }
}
