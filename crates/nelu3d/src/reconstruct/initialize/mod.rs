//! The initial surface: decoded from a cost volume, or propagated from the previous frame's surface; and, for color
//! cameras, the crosstalk matrix, found together with it.

mod crosstalk;
mod decoder;
mod propagate;
mod settings;
mod small_components;

use super::context::Context;
use super::error::Failure;
use super::filter::nothing_left;
use super::observer::Stage;
use super::options::CrosstalkMode;
use super::previous::PreviousFrame;
use super::scene::Scene;
use super::settings::FastSettings;
use crate::color_field::SplineEvaluator;
use crate::sensor::CrosstalkMatrix;
pub(crate) use decoder::Decoder;
pub use decoder::InitialDepth;
pub use settings::{CrosstalkSettings, PropagationSettings};

/// The initial surface of a scene.
pub(crate) struct Initial {
    /// Inverse depth per pixel, and the spacing of depth hypotheses.
    pub(crate) depth: InitialDepth,
    /// Fraction of the pixels that were decoded in the whole volume all the same, where the surface was propagated from
    /// the previous frame; `None` where it was found from the scene alone.
    pub(crate) decoded: Option<f32>,
    /// The crosstalk that was corrected; `None` where there can be none or none is asked for.
    pub(crate) crosstalk: Option<CrosstalkMatrix>,
}

/// Finds the initial surface of a scene. Corrects the crosstalk of its measurements, and marks pixels whose rays miss
/// the calibrated volume.
///
/// Where nothing near the previous frame's surface explains what is measured, the whole volume is decoded; where that
/// is most of the image, the surface is found from the scene alone.
pub(crate) fn initialize(
    scene: &mut Scene<'_>,
    previous: Option<&PreviousFrame>,
    mode: CrosstalkMode,
    settings: &FastSettings,
    cx: &mut Context<'_>,
) -> Result<Initial, Failure> {
    cx.clock.begin("decode the cost volume");
    let board = scene.board_white().filter(|_| mode == CrosstalkMode::Auto);
    let Scene { camera, part, field, grid, rays, measurements: m, .. } = scene;
    let spline = SplineEvaluator::new(grid, field.metadata.cells_per_pixel);
    let decoder = Decoder {
        camera,
        origin: part.origin,
        field,
        rays,
        spline: &spline,
        settings,
        device: &cx.device,
        progress: cx.progress,
    };

    let measured = board.is_some().then(|| m.clone());
    let known = field.metadata.crosstalk;
    let mut crosstalk = known.or(previous.and_then(|p| p.crosstalk)).unwrap_or(CrosstalkMatrix::NONE);
    if let Some(board) = board.as_ref().filter(|_| crosstalk != CrosstalkMatrix::NONE) {
        m.correct_crosstalk(&crosstalk, board);
    }
    let (depth, decoded) = match previous.and_then(|previous| propagate::start(&decoder, &previous.depth, m)) {
        Some((depth, decoded)) => (depth, Some(decoded)),
        None => {
            let mut depth = decoder.decode_filled(m);
            if let (Some(board), Some(measured), None) = (&board, &measured, known) {
                crosstalk::alternate(&decoder, measured, board, &mut crosstalk, m, &mut depth);
            }
            (depth, None)
        }
    };
    if depth.inv_z.iter().all(|z| z.is_nan()) {
        return Err(nothing_left(scene));
    }
    cx.stop_if_cancelled()?;
    cx.observe(Stage::Decode, 1, || depth.inv_z.iter().map(|v| 1.0 / v).collect());
    Ok(Initial { depth, decoded, crosstalk: board.is_some().then_some(crosstalk) })
}
