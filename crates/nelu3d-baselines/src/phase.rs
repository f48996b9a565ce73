//! Phase shifting: three or more shifts of each of one or several frequencies.
//!
//! The phase of each frequency is a linear least-squares fit per pixel, for any shifts. The finest phase says where in
//! its period a column is; the others say which period: among all columns with the finest phase, the one whose other
//! phases agree best with what was seen (χ²). Then all unwrapped phases are averaged by their variances.

use nelu3d_scan::pattern::{PhaseDecoder, PhaseSolver, repeats_after};
use nelu3d_scan::rig::PatternSet;

use super::captured::Captured;
use super::code::Code;
use super::coordinates::DecodedCoordinates;
use super::error::DecodeError;
use super::per_pixel::decode_pixels;
use super::triangulate::Geometry;
use super::wave::{learn, planes};

/// Decodes all axes of a code.
pub(crate) fn decode(
    captured: &Captured,
    code: &Code,
    set: &PatternSet,
    geometry: &Geometry<'_>,
) -> Result<DecodedCoordinates, DecodeError> {
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let groups = learn(axis, set, "phase")?;
        let unsuited = |problem: String, remedy: String| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "phase",
            problem,
            remedy,
        };
        if let Some(g) = groups.iter().find(|g| PhaseSolver::new(g).is_none()) {
            let problem =
                format!("it has {} image(s) of period {:.2} px, and 3 shifts are needed", g.waves.len(), g.period_px());
            return Err(unsuited(
                problem,
                "use setting `method` mps (three shifts of one frequency, one image of each other) or zncc".into(),
            ));
        }
        let decoder = PhaseDecoder::from_groups(&groups, axis.len())
            .map_err(|e| unsuited(e.to_string(), "use setting `method` zncc".into()))?;
        let planes = planes(captured, &groups);
        // Where columns may be looked for: everywhere if the code is unique there, else where the depth range allows.
        let whole = [-0.5, axis.len() as f32 - 0.5];
        let repeats = repeats_after(&groups, axis.len() as f64);
        let span = geometry.longest_interval(axis.axis);
        if let Some(period) = repeats
            && period < span
        {
            return Err(unsuited(
                format!("its code repeats every {period:.1} px, and the depth range spans {span:.1} px"),
                format!(
                    "add a frequency, or give a setting `depth` that spans less (now {:.0} to {:.0} mm)",
                    geometry.range.mm[0], geometry.range.mm[1]
                ),
            ));
        }
        let interval = |i: usize| if repeats.is_none() { Some(whole) } else { geometry.interval(i, axis) };
        let decode = |i: usize, sigma: f32, within| decoder.decode_within(|image| planes[image][i], sigma, within);
        coordinates.push(decode_pixels(captured, axis.axis, &mut status, interval, decode));
    }
    Ok(DecodedCoordinates { coordinates, status })
}
