//! Three patterns at once, as the color channels of one image.

use super::error::PatternError;
use crate::image::Image;

/// Makes the images of three patterns (red, green, blue) the channels of one image each.
///
/// # Errors
///
/// The patterns make different numbers of images, or images of several channels.
pub(super) fn interleave(parts: [Vec<Image>; 3]) -> Result<Vec<Image>, PatternError> {
    let counts = [parts[0].len(), parts[1].len(), parts[2].len()];
    let mono = parts.iter().flatten().all(|i| i.channels == 1);
    if !mono || counts[0] != counts[1] || counts[0] != counts[2] {
        return Err(PatternError::Parts { counts });
    }
    let image = |i: usize| {
        let (width, height) = (parts[0][i].width, parts[0][i].height);
        let data = (0..width * height).flat_map(|p| [0, 1, 2].map(|c| parts[c][i].data[p])).collect();
        Image { width, height, channels: 3, data }
    };
    Ok((0..counts[0]).map(image).collect())
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, Gray, Pattern, Ramp, Rgb, Sinusoid};
    use super::*;

    #[test]
    fn channels_are_the_parts() {
        let part = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 2 });
        let parts = [part(8.0), part(9.0), part(11.0)];
        let rgb = Pattern::Rgb(Rgb { parts: parts.clone().map(Box::new) }).generate(30, 4).unwrap().images;
        assert_eq!(rgb.len(), 2);
        for (c, part) in parts.iter().enumerate() {
            for (image, expected) in rgb.iter().zip(part.generate(30, 4).unwrap().images) {
                let channel: Vec<f32> = image.image.data.iter().skip(c).step_by(3).copied().collect();
                assert_eq!(channel, expected.image.data);
            }
        }
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        let ramp = || Box::new(Pattern::Ramp(Ramp::default()));
        let gray = Box::new(Pattern::Gray(Gray::default()));
        let error = Pattern::Rgb(Rgb { parts: [ramp(), ramp(), gray] }).generate(16, 4).unwrap_err();
        assert_eq!(error, PatternError::Parts { counts: [1, 1, 4] });
        let nested = Box::new(Pattern::Rgb(Rgb { parts: [ramp(), ramp(), ramp()] }));
        assert!(Pattern::Rgb(Rgb { parts: [ramp(), ramp(), nested] }).generate(16, 4).is_err());
    }
}
