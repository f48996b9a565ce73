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

#[cfg(test)]
mod tests {
    use nelu3d_scan::pattern::WaveGroup;

    use super::*;
    use crate::wave::tests::sinusoids;

    fn groups(parts: &[(f64, usize)]) -> Vec<WaveGroup> {
        let set = PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() };
        learn(&sinusoids(640, parts), &set, "phase").unwrap()
    }

    #[test]
    fn a_code_repeats_after_its_beat() {
        assert!((repeats_after(&groups(&[(16.0, 3)]), 640.0).unwrap() - 16.0).abs() < 0.01);
        assert!(repeats_after(&groups(&[(16.0, 3), (640.0, 3)]), 640.0).is_none());
        // 16 and 20: 80.
        assert!((repeats_after(&groups(&[(16.0, 3), (20.0, 3)]), 640.0).unwrap() - 80.0).abs() < 0.1);
    }

    #[test]
    fn every_column_comes_back_from_its_intensities() {
        let parts = [(18.0, 4), (60.0, 3), (640.0, 3)];
        let code = sinusoids(640, &parts);
        let groups = groups(&parts);
        let planes: Vec<Vec<f32>> = code.lines.iter().map(|l| l.values.clone()).collect();
        let decoder = PhaseDecoder::from_groups(&groups, 640).unwrap();
        for u in 0..640 {
            let found = decoder.decode_within(|image| planes[image][u], 0.0015, [-0.5, 639.5]).unwrap();
            // Eight bits: 1/255/√12 of noise over an amplitude of one half.
            assert!(
                found.is_reliable() && (found.column - u as f32).abs() < 0.03 && found.sigma < 0.03,
                "{found:?} for {u}"
            );
        }
        // The finest phase alone does not tell which period: none is invented.
        let finest = PhaseDecoder::from_groups(&groups[..1], 640).unwrap();
        let found = finest.decode_within(|image| planes[image][100], 0.0015, [-0.5, 639.5]);
        assert!(!found.unwrap().is_reliable());
    }
}
