//! TurboSL (Mirdehghan, Wu, Chen, Lindell & Kutulakos, "TurboSL: Dense, Accurate and Fast 3D by Neural Inverse
//! Structured Light", CVPR 2024): a signed distance field, an albedo, an ambient term and the projector's blur, trained
//! so that the captures are rendered from the patterns and the patterns from the captures.
//!
//! Settings are those of its public configuration and code. Half of the rays are the projector's from the first
//! iteration on; their image loss counts from a tenth of the iterations on. Deviations: the first shape is a sphere
//! unless another is asked for; with fewer samples than published they are placed where the surface may be; an image
//! that changes along one axis is blurred along that alone; clipped pixels are left out; and the depth is that of
//! NeuS's own quadrature at the end. `ray.rs` is the image formation, `scene.rs` what is known, `step.rs` one
//! iteration.

pub mod blur;
mod diagnostics;
mod options;
mod projected;
pub mod ray;
mod render;
mod scene;
mod step;
mod train;

use nelu3d::progress::Progress;
use nelu3d::surface::SurfaceMaps;

use crate::captured::Captured;
use crate::error::DecodeError;
pub use diagnostics::{ProjectorBlur, TurboSlDiagnostics};
pub use options::TurboSlOptions;
pub use projected::{BlurGradient, Projected, ProjectedPlanes};
use render::render_surface;
pub(crate) use scene::TurboSlScene;
use train::train;

/// A decoded surface and the record of its training.
pub(crate) struct TurboSlResult {
    pub(crate) maps: SurfaceMaps,
    /// Normals of the signed distance field itself; NaN where there is no depth.
    pub(crate) normals: Vec<[f32; 3]>,
    pub(crate) diagnostics: TurboSlDiagnostics,
}

/// Trains the scene's model and renders it.
///
/// # Errors
///
/// The training diverged, or the caller stopped it.
pub(crate) fn decode(
    scene: &TurboSlScene<'_>,
    captured: &Captured,
    opts: &TurboSlOptions,
    progress: &Progress,
) -> Result<TurboSlResult, DecodeError> {
    let (model, grid, losses) = train(scene, opts, progress)?;
    let (maps, normals) = render_surface(scene, &model, &grid, captured);
    let blur = ProjectorBlur { x: model.blur[0].taps(), y: model.blur[1].taps() };
    let diagnostics = TurboSlDiagnostics { losses, unit_mm: scene.bounds.unit_mm, blur };
    Ok(TurboSlResult { maps, normals, diagnostics })
}
