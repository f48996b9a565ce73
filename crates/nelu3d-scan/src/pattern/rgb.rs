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
