//! Micro phase shifting (Gupta & Nayar, "Micro Phase Shifting", CVPR 2012): F frequencies from a narrow band in F + 2
//! images, three shifts of the first and one image of each other.
//!
//! All frequencies being close, offset and amplitude are the same for all (that is the method's point: indirect light
//! hardly changes within a band of high frequencies). Offset o, amplitude B and phase of the first frequency come from
//! its shifts, the others give `cos(2π f_j u − φ_j) = (p_j − o) / B`: the paper's linear system of F + 2 unknowns,
//! solved in two steps. The column is the one, among those with the first frequency's phase, whose cosines are nearest
//! to these (its section 4), so that the fraction of a column is that of the first phase.

use nelu3d_scan::pattern::{MpsDecoder, PhaseSolver};
use nelu3d_scan::rig::PatternSet;

use super::captured::Captured;
use super::code::Code;
use super::coordinates::DecodedCoordinates;
use super::error::DecodeError;
use super::options::Columns;
use super::per_pixel::decode_pixels;
use super::triangulate::Geometry;
use super::wave::{learn, planes};

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
    search: Columns,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let groups = learn(axis, set, "mps")?;
        let shifted: Vec<usize> = (0..groups.len()).filter(|g| groups[*g].waves.len() > 1).collect();
        let (&[first], true) = (&shifted[..], groups.len() > 1) else {
            return Err(DecodeError::Unsuited {
                set: set.name.clone(),
                method: "mps",
                problem: format!("{} of its {} frequencies have several shifts", shifted.len(), groups.len()),
                remedy:
                    "micro phase shifting has three shifts of one frequency and one image of each other; use setting `method` \
                         phase or zncc for other codes"
                        .into(),
            });
        };
        let unsuited = |problem: String| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "mps",
            problem,
            remedy: "give that frequency three shifts".into(),
        };
        if PhaseSolver::new(&groups[first]).is_none() {
            let period = groups[first].period_px();
            return Err(unsuited(format!("the shifts of period {period:.2} px do not determine a phase")));
        }
        let decoder = MpsDecoder::from_groups(&groups, axis.len()).map_err(|e| unsuited(e.to_string()))?;
        let planes = planes(captured, &groups);
        let whole = [-0.5, axis.len() as f32 - 0.5];
        let decode = |i: usize, sigma: f32, within| decoder.decode_within(|image| planes[image][i], sigma, within);
        let interval = |i: usize| if search == Columns::All { Some(whole) } else { geometry.interval(i, axis) };
        coordinates.push(decode_pixels(captured, axis.axis, &mut status, interval, decode));
    }
    Ok(DecodedCoordinates { coordinates, status })
}
