//! Point clouds that keep the camera's grid of pixels, and their files.
//!
//! | format | layout | lengths and axes |
//! |---|---|---|
//! | `.pcd` | organized: one point a pixel, NaN where there is none | mm, camera frame (x right, y down, z forward) |
//! | `.e57` | points that there are, with row and column | **meters**, camera frame, as ASTM E2807 demands |

mod e57;
mod organized;
mod pcd;

use std::io;
use std::path::Path;

pub use organized::OrganizedCloud;

use crate::output::write_atomic;

/// Writes an organized binary PCD file (Point Cloud Library, version 0.7), with σ as the field `sigma`.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If the parts differ in length.
pub fn write_pcd(path: &Path, cloud: &OrganizedCloud) -> io::Result<()> {
    cloud.assert_whole();
    write_atomic(path, |w| pcd::write(cloud, w))
}

/// Writes an E57 file, with σ in meters as the attribute `nelu3d:sigma`. `guid` is what its content is known by.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If the parts differ in length.
pub fn write_e57(path: &Path, cloud: &OrganizedCloud, guid: &str) -> io::Result<()> {
    cloud.assert_whole();
    let bytes = e57::encode(cloud, guid).map_err(|e| io::Error::other(format!("{}: {e}", path.display())))?;
    write_atomic(path, |w| w.write_all(&bytes))
}
