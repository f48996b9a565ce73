//! The page of a surface that moves while one looks: it asks its server for one surface after the other.

use nelu3d_scan::Mesh;

use super::html::{escape, fill};
use super::mesh::PageMesh;
use super::page::{STYLE, VIEWER};
use super::viewer::{Coloring, live_viewer};

const TEMPLATE: &str = include_str!("live.html");

/// Style of the page, which asks for it as `style.css`.
pub const LIVE_STYLE: &str = STYLE;

/// Scripts of the page by the names that it asks for.
pub const LIVE_SCRIPTS: [(&str, &str); 2] = [("viewer.js", VIEWER), ("live.js", include_str!("live.js"))];

/// Returns the page; `title` and `subtitle` are text. It asks for its style, its scripts, and `surface?after=N`, which
/// is answered by `{"published": N, "ended": false, "surface": …}` with what [`live_surface`] returns, or `null`.
pub fn live_page(title: &str, subtitle: &str) -> String {
    let colorings = [Coloring::Clay, Coloring::Photo, Coloring::Depth, Coloring::Normals];
    let parts = [("title", escape(title)), ("subtitle", escape(subtitle)), ("body", live_viewer(&colorings))];
    fill(TEMPLATE, &parts)
}

/// A surface of the page, and what is said of it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct LiveSurface<'a> {
    /// Name of the frame.
    pub frame: &'a str,
    /// What is shown of it: `carried` (the surface of an earlier frame, moved along), `first`, or `refined`.
    pub stage: &'static str,
    /// Frames that were shown per second lately; `None` before there are two.
    pub rate: Option<f64>,
    /// Seconds from when the frame was complete to now.
    pub late_secs: f64,
    /// Frames that were left out of the view so far.
    pub left_out: usize,
    /// What else there is to say.
    pub message: &'a str,
}

/// Returns the JSON object of a surface for the page's script; `mesh` in the camera's frame, mm, none to leave what is
/// shown.
pub fn live_surface(about: &LiveSurface<'_>, mesh: Option<&Mesh>) -> String {
    #[derive(serde::Serialize)]
    struct Message<'a> {
        #[serde(flatten)]
        about: &'a LiveSurface<'a>,
        mesh: Option<PageMesh>,
    }
    serde_json::to_string(&Message { about, mesh: mesh.and_then(PageMesh::of) }).expect("plain data")
}
