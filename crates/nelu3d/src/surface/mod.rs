//! A reconstructed surface as a type: per-pixel maps, why a pixel has no depth, connectivity, normals, triangles.
//!
//! Every method, ours and the baselines alike, ends here: it fills [`SurfaceMaps`] and calls [`assemble()`].

mod assemble;
mod links;
#[doc(hidden)]
pub mod mesh;
mod pixel_status;
mod types;

pub use assemble::{MAX_SLOPE, assemble, image_plane, reject_small_components};
pub use links::Links;
pub use mesh::normals_from_links;
pub use pixel_status::PixelStatus;
pub use types::{Surface, SurfaceMaps};
