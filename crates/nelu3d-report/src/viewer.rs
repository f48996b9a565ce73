//! A surface that can be turned, colored in several ways. A page may hold several.

use std::fmt::Write;

use nelu3d_scan::Mesh;

use super::mesh::PageMesh;

/// What a surface can be colored by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coloring {
    /// One color, shaded.
    Clay,
    /// The vertices' colors as they are: a photo.
    Photo,
    /// Camera z, shaded.
    Depth,
    /// Normals.
    Normals,
    /// The vertices' colors, shaded: a quantity.
    Colored(&'static str),
}

impl Coloring {
    /// Returns the label of its button.
    fn label(self) -> &'static str {
        match self {
            Self::Clay => "Clay",
            Self::Photo => "Photo",
            Self::Depth => "Depth",
            Self::Normals => "Normals",
            Self::Colored(what) => what,
        }
    }

    /// Returns its number in viewer.js.
    fn mode(self) -> u8 {
        match self {
            Self::Clay => 0,
            Self::Photo => 1,
            Self::Depth => 2,
            Self::Normals => 3,
            Self::Colored(_) => 4,
        }
    }
}

/// Returns a surface in the camera's frame with a button for each coloring, the first one chosen.
pub fn viewer(mesh: &Mesh, colorings: &[Coloring]) -> String {
    let data = serde_json::to_string(&PageMesh::of(mesh)).expect("plain data");
    section("class=viewer", &data, colorings)
}

/// Returns a viewer without a surface yet, which a script of the page shows one after the other.
pub(super) fn live_viewer(colorings: &[Coloring]) -> String {
    section("class=viewer data-live", "null", colorings)
}

fn section(attributes: &str, data: &str, colorings: &[Coloring]) -> String {
    let buttons = colorings.iter().enumerate().fold(String::new(), |mut s, (i, c)| {
        let _ = write!(s, "<button data-mode={} aria-pressed={}>{}</button>", c.mode(), i == 0, c.label());
        s
    });
    format!(
        "<section {attributes}><canvas tabindex=0 aria-label='The surface; drag to turn it, wheel or pinch to \
         zoom'></canvas><div class=modes role=group aria-label=Coloring>{buttons}<button \
         data-reset>Reset</button></div><p class=hint>Drag to turn · wheel or pinch to zoom · shift-drag or two fingers \
         to move</p><script type='application/json'>{data}</script></section>"
    )
}
