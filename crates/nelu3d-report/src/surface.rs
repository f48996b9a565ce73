//! The page of a surface alone, small enough to stand inside another page: a notebook's.

use nelu3d::Surface;
use nelu3d::result::picture::preview;

use crate::html::img;
use crate::page::page;
use crate::viewer::{Coloring, viewer};

/// Returns a whole page with the surface, which can be turned, and the picture of [`surface_picture`] above it. `title`
/// and `subtitle` are text. It needs no other file and no network.
pub fn surface_page(title: &str, subtitle: &str, surface: &Surface) -> String {
    let colorings = [Coloring::Clay, Coloring::Photo, Coloring::Depth, Coloring::Normals];
    let picture = img(&preview(surface), "The capture, the surface, and the surface in the colors of its depth");
    let body = format!("<figure>{picture}</figure>{}", viewer(&surface.mesh, &colorings));
    page(title, subtitle, &body)
}

/// Returns the picture of a surface as a PNG file: the capture, the surface as clay, and in the colors of its depth.
pub fn surface_picture(surface: &Surface) -> Vec<u8> {
    preview(surface).png()
}
