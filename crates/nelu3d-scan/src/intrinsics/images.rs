//! Boards in a folder's images.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::board::{Corner, Detector};

/// A linear gray image.
#[derive(Clone, Debug, PartialEq)]
pub struct GrayImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `height × width` values, where 1 and more is clipped.
    pub data: Vec<f32>,
}

/// The corners of the board in an image, or why there are none.
type Found = Result<Vec<Corner>, String>;

/// Finds the board in `n` images, in parallel; `load` reads one of them, and each is dropped before the next is read.
/// `tick` is told how many are done, and returns whether to go on. The answer has the corners of each image or why there
/// are none, in order; `None` where `tick` ended the work.
///
/// # Errors
///
/// The first that `load` had.
pub fn find_boards<E: Send>(
    detector: &Detector,
    n: usize,
    load: impl Fn(usize) -> Result<GrayImage, E> + Sync,
    tick: impl Fn(usize) -> bool + Sync,
) -> Result<Option<Vec<Found>>, E> {
    let done = AtomicUsize::new(0);
    let one = |i: usize| -> Result<Option<Found>, E> {
        if !tick(done.load(Ordering::Relaxed)) {
            return Ok(None);
        }
        let image = load(i)?;
        let found = detector.detect(&image.data, image.width, image.height).map_err(|e| e.to_string());
        tick(done.fetch_add(1, Ordering::Relaxed) + 1);
        Ok(Some(found))
    };
    let all: Result<Vec<Option<Found>>, E> = (0..n).into_par_iter().map(one).collect();
    Ok(all?.into_iter().collect())
}
