//! Where the boards were: the depth that they span, in numbers that a person can check, and whether it is enough.

use nalgebra::Point3;
use nelu3d_scan::statistics::median;
use serde::Serialize;

use crate::calibrate::placed_sweep::PlacedSweep;
use crate::color_field::ColorField;
use crate::verdict::{Code, Finding, Verdict};

/// The depths that the boards of a sweep span, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DepthSpan {
    /// Smallest depth of a point of a board in view.
    pub near_mm: f64,
    /// Largest depth of a point of a board in view.
    pub far_mm: f64,
    /// Mean depth of such points.
    pub middle_mm: f64,
    /// Median over the rays that several boards meet of the distance between the first and the last; of all boards on
    /// the middle ray where few rays meet several.
    pub along_rays_mm: f64,
}

/// Span along the rays below which there is no volume, as a fraction of the depth.
const NO_SPAN: f64 = 0.003;
/// Span along the rays below which little is known of what lies beyond, as a fraction of the depth.
const LITTLE_SPAN: f64 = 0.012;

impl DepthSpan {
    /// Measures the boards of a sweep in the camera's view.
    pub(in crate::calibrate) fn of(placed: &PlacedSweep<'_>) -> Self {
        let (mut near, mut far, mut sum, mut n) = (f64::INFINITY, 0.0f64, 0.0, 0usize);
        let (mut spans, mut seen) = (Vec::new(), 0usize);
        for dir in placed.dirs.iter().step_by((placed.dirs.len() / 2000).max(1)) {
            let hits: Vec<f64> = placed.boards.iter().filter_map(|b| b.hit(dir)).collect();
            for t in &hits {
                let z = t * dir.z;
                (near, far, sum, n) = (near.min(z), far.max(z), sum + z, n + 1);
            }
            seen += usize::from(!hits.is_empty());
            if hits.len() > 1 {
                let last = hits.iter().copied().fold(0.0, f64::max);
                spans.push(last - hits.iter().copied().fold(f64::INFINITY, f64::min));
            }
        }
        let along = match spans.len() * 5 >= seen {
            true => median(&mut spans).unwrap_or(0.0),
            false => {
                let depths = placed.depths().into_iter();
                let (lo, hi) = depths.fold((f64::INFINITY, 0.0f64), |(lo, hi), t| (lo.min(t), hi.max(t)));
                hi - lo
            }
        };
        Self { near_mm: near, far_mm: far, middle_mm: sum / n.max(1) as f64, along_rays_mm: along }
    }
}

/// Judges the depth that the boards span.
pub(super) fn judge(span: &DepthSpan, field: &ColorField) -> Option<Finding> {
    let share = span.along_rays_mm / span.middle_mm;
    let verdict = match share {
        s if s < NO_SPAN => Verdict::Bad,
        s if s < LITTLE_SPAN => Verdict::Doubtful,
        _ => return None,
    };
    let sentence = format!(
        "the boards span {:.1} mm along the camera's rays at {:.0} mm of depth, which tells little of how codewords \
         change with depth",
        span.along_rays_mm, span.middle_mm
    );
    let remedy = "sweep the board through the whole depth of what will be scanned";
    let light = field.frame.center().map(|c| (c - Point3::origin()).norm());
    Some(
        Finding::new(Code::DepthRange, verdict, sentence, remedy)
            .with("along_rays_mm", span.along_rays_mm)
            .with("depth_mm", span.middle_mm)
            .with("center_distance_mm", light),
    )
}
