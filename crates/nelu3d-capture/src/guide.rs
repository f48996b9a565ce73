//! The sweep as a guided job: is the board found, what is covered, and what to do next.

use nelu3d_scan::board::{Board, BoardError, Corner, Detector};
use nelu3d_scan::image::{Channels, Raw};
use nelu3d_scan::pose::solve_pnp;
use nelu3d_scan::rig::Rig;

use crate::error::CaptureError;

/// Cells of the picture along x and y whose coverage is counted.
const CELLS: [usize; 2] = [8, 6];
/// Positions to take: the demo's sweep; with fewer the field between them is a guess.
const WANTED_POSITIONS: usize = 24;
/// Steps of depth that should have a position each.
const DEPTH_STEPS: usize = 8;

/// What a picture shows of the board.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct BoardView {
    /// Where corners were found, px.
    pub corners_px: Vec<[f64; 2]>,
    /// Camera-frame depth of the corners' middle, mm, where the intrinsics are known.
    pub depth_mm: Option<f64>,
    /// Mean distance of a board's corners, px per mm: the nearer, the larger.
    pub px_per_mm: f64,
    /// Angle between the board's normal and the line of sight, degrees, where the intrinsics are known.
    pub tilt_deg: Option<f64>,
}

/// What the positions so far cover.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Coverage {
    /// Positions taken.
    pub positions: usize,
    /// Positions to take.
    pub wanted: usize,
    /// Columns and rows of `cells`.
    pub grid: [usize; 2],
    /// How many positions had corners in each cell of the picture, row by row.
    pub cells: Vec<usize>,
    /// Depths of the positions, mm, in the order they were taken; empty without intrinsics.
    pub depths_mm: Vec<f64>,
}

/// Follows a sweep.
pub struct SweepGuide {
    rig: Rig,
    has_intrinsics: bool,
    detector: Option<Detector>,
    size: [usize; 2],
    views: Vec<BoardView>,
}

impl SweepGuide {
    /// Returns a guide for the board of a rig; without a board nothing is looked for.
    ///
    /// # Errors
    ///
    /// The board cannot be printed as described.
    pub fn new(rig: &Rig, has_intrinsics: bool) -> Result<Self, BoardError> {
        let detector = |board: &Board| {
            let detector = Detector::new(board)?;
            Ok(if has_intrinsics { detector.with_camera(&rig.camera) } else { detector })
        };
        let detector = rig.board.as_ref().map(detector).transpose()?;
        Ok(Self { rig: rig.clone(), has_intrinsics, detector, size: [1, 1], views: Vec::new() })
    }

    /// Returns whether there is a board to look for.
    pub fn has_board(&self) -> bool {
        self.detector.is_some()
    }

    /// Looks for the board in a picture of the flash.
    ///
    /// # Errors
    ///
    /// The picture does not fit to the rig.
    pub fn find(&mut self, raw: &Raw) -> Result<Result<BoardView, String>, CaptureError> {
        let Some(detector) = &self.detector else { return Ok(Err("rig.toml describes no board".into())) };
        self.size = [raw.width, raw.height];
        let (rig, file) = (&self.rig, self.rig.root.join("(live)"));
        let image = rig.linear(raw, &file, rig.channels)?;
        let gray: Vec<f32> = match rig.channels {
            Channels::Mono => image.data,
            // Clipped in one channel is clipped.
            _ => image.data.chunks_exact(3).map(|p| p.iter().sum::<f32>() / 3.0).collect(),
        };
        Ok(detector.detect(&gray, raw.width, raw.height).map(|found| self.view(&found)).map_err(|e| e.to_string()))
    }

    fn view(&self, found: &[Corner]) -> BoardView {
        let corners_px: Vec<[f64; 2]> = found.iter().map(|c| c.px).collect();
        // Of all pairs of neighbors in the list; corners of one board are listed in its order.
        let lengths = found.windows(2).map(|w| {
            let d = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
            d(w[0].px, w[1].px) / d(w[0].board_mm, w[1].board_mm).max(1e-9)
        });
        let px_per_mm = lengths.sum::<f64>() / found.len().saturating_sub(1).max(1) as f64;
        let pose = self.has_intrinsics.then(|| solve_pnp(found, &self.rig.camera).ok()).flatten();
        let middle = |i: usize| found.iter().map(|c| c.board_mm[i]).sum::<f64>() / found.len().max(1) as f64;
        let at = pose.as_ref().map(|p| p.cam_from_board * nalgebra::Point3::new(middle(0), middle(1), 0.0));
        let tilt = pose.as_ref().zip(at).map(|(p, at)| {
            let normal = p.cam_from_board * nalgebra::Vector3::z();
            normal.dot(&at.coords.normalize()).abs().min(1.0).acos().to_degrees()
        });
        BoardView { corners_px, depth_mm: at.map(|p| p.z), px_per_mm, tilt_deg: tilt }
    }

    /// Notes a position that was taken.
    pub fn add(&mut self, view: BoardView) {
        self.views.push(view);
    }

    /// Returns what the positions cover.
    pub fn coverage(&self) -> Coverage {
        let mut cells = vec![0; CELLS[0] * CELLS[1]];
        for view in &self.views {
            let mut hit = vec![false; cells.len()];
            for [x, y] in &view.corners_px {
                let cell =
                    |v: f64, side: usize, n: usize| ((v + 0.5) / side as f64 * n as f64).clamp(0.0, n as f64 - 1.0);
                let [x, y] = [cell(*x, self.size[0], CELLS[0]), cell(*y, self.size[1], CELLS[1])];
                hit[y as usize * CELLS[0] + x as usize] = true;
            }
            cells.iter_mut().zip(hit).for_each(|(n, hit)| *n += usize::from(hit));
        }
        let depths_mm = self.views.iter().filter_map(|v| v.depth_mm).collect();
        Coverage { positions: self.views.len(), wanted: WANTED_POSITIONS, grid: CELLS, cells, depths_mm }
    }

    /// Returns what to do next, in words.
    pub fn next_step(&self) -> String {
        let n = self.views.len();
        if n == 0 {
            return "put the board where the object will be, as near as it will ever be, and take a position".into();
        }
        let depths = self.coverage().depths_mm;
        if let Some(gap) = largest_gap(&depths).filter(|_| n >= DEPTH_STEPS) {
            return format!("no position lies between {:.0} and {:.0} mm: put the board there", gap[0], gap[1]);
        }
        if n < WANTED_POSITIONS {
            let next = if n % 6 == 5 { "tilt the board a little as well" } else { "keep it about upright" };
            return format!("move the board back by a step, {next}; {} of {WANTED_POSITIONS} positions", n + 1);
        }
        "enough positions; go on to the scenes, or add positions where the object will be".into()
    }
}

/// Returns the neighboring depths that are further apart than two and a half even steps, if there are such.
fn largest_gap(depths: &[f64]) -> Option<[f64; 2]> {
    let mut sorted = depths.to_vec();
    sorted.sort_by(f64::total_cmp);
    let even = (sorted.last()? - sorted.first()?) / (sorted.len() - 1).max(1) as f64;
    let gaps = sorted.windows(2).map(|w| [w[0], w[1]]);
    gaps.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).filter(|g| g[1] - g[0] > 2.5 * even.max(1.0))
}

impl std::fmt::Debug for SweepGuide {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SweepGuide").field("views", &self.views.len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_in_depth_are_named() {
        assert_eq!(largest_gap(&[700.0, 600.0, 610.0, 620.0, 630.0, 640.0]), Some([640.0, 700.0]));
        assert_eq!(largest_gap(&[600.0, 620.0, 610.0, 631.0]), None);
        assert_eq!(largest_gap(&[]), None);
    }
}
