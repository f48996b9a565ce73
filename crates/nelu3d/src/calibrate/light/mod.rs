//! Where the light comes from, found from the sweep alone.
//!
//! Two board positions that the same ray of light meets show the same codeword. So the center of the light is the point
//! for which every sample of one position, carried along its ray of light to another position, finds its own codeword
//! there. It is searched for coarse to fine ([`search`]), then found by robust Gauss-Newton ([`refine`]) with lever
//! arms (distances between the two positions) that grow as the center gets better. No model of the projector is
//! involved but that its light is straight.

mod center;
mod disagreement;
mod refine;
mod search;
mod transport;

use nalgebra::{Const, Point3, SymmetricEigen, Vector3};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::excluded::ExcludedBlocks;
use super::views::Views;
use crate::progress::Progress;
pub(super) use center::LightCenter;
use center::{Chart, HOME, State};
use disagreement::disagreeing_blocks;
use refine::{Held, Refined, Steps, refine};
use search::{search_levels, starts};
use transport::{PULL, Seed, Transport, disagreement, seeds};

/// Numbers of a sweep that the last refinement looks at: samples times channels.
const MEASUREMENTS: usize = 720_000;
/// Samples that the refinements with shorter arms, before it, look at: every so many-th, but no fewer than these if
/// there are as many.
const FEWER: (usize, usize) = (4, 5000);
/// Factor by which residuals may rise where the center is moved along the line that codes of one axis leave open.
const MAX_WORSE: f64 = 1.02;
/// Disagreement with the other positions beyond which a position has no consensus with them.
const NO_CONSENSUS: f64 = 0.6;

/// What the search found.
pub(super) struct FoundLight {
    pub(super) center: LightCenter,
    /// Positions of the sweep whose codewords do not fit the others': their poses are wrong, or something stood in the
    /// light.
    pub(super) without_consensus: Vec<usize>,
    /// Positions of the sweep, and the parts of their images whose codewords do not fit the others'.
    pub(super) excluded: Vec<(usize, ExcludedBlocks)>,
}

/// Finds the center of the light, or `None` when there are too few samples (or somebody stopped the work).
pub(super) fn find_center(mut views: Views, camera: &Camera, progress: &Progress) -> Option<FoundLight> {
    let all = seeds(camera, &views, &views.levels[0], 2000);
    if all.len() < 200 || views.len() < 2 {
        return None;
    }
    let mean = all.iter().map(|s| s.point.coords).sum::<Vector3<f64>>() / all.len() as f64;
    let chart = Chart::new(Point3::from(mean));
    let mut found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    let outliers = without_consensus(&Transport { camera, views: &views, chart: &chart }, &found);
    let mut without_consensus = Vec::new();
    if outliers.iter().any(|o| *o) {
        without_consensus = (0..views.len()).filter(|i| outliers[*i]).map(|i| views.positions[i]).collect();
        let keep: Vec<bool> = outliers.iter().map(|o| !o).collect();
        views.retain(&keep);
        found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    }
    let line = undetermined(&chart, &found);
    let center = LightCenter { line, ..chart.center(found.state) };
    tracing::debug!(position = ?center.position(), scale = found.scale, ?line, "light");
    let blocks = disagreeing_blocks(&Transport { camera, views: &views, chart: &chart }, &center);
    let excluded = views.positions.iter().copied().zip(blocks).filter_map(|(p, b)| b.map(|b| (p, b))).collect();
    Some(FoundLight { center, without_consensus, excluded })
}

/// Searches the center and refines the best of what was found, with lever arms that grow.
fn search(t: &Transport<'_>, progress: &Progress) -> Option<Refined> {
    let levels = search_levels(t);
    let finest = levels.first()?;
    let (n, k) = (t.views.len(), t.views.k);
    let last = (n / 3).max(3.min(n - 1));
    let mut candidates = different(starts(t, &levels));
    candidates.push(HOME);
    let scored = candidates.into_par_iter().map(|start| {
        let arms = [1, 2, 4].into_iter().filter(|arm| *arm <= last);
        let s = arms.fold(start, |s, arm| refine(t, finest.level, &finest.seeds, s, finest.steps(k, arm)).state);
        (t.score(finest.level, &finest.seeds, s, 2.min(last), finest.by_chance, 1.0), s)
    });
    let scored: Vec<_> = scored.collect();
    let (score, state) = scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    tracing::debug!(score, ?state, "best start of the light");
    let all = seeds(t.camera, t.views, finest.level, MEASUREMENTS / t.views.k.max(6));
    // What short arms find is where longer ones begin.
    let few: Vec<Seed> = all.iter().step_by((all.len() / FEWER.1).clamp(1, FEWER.0)).copied().collect();
    let how = Steps { arm: last, count: 12, min_scale: 0.1 * finest.spread(k), pull: PULL, far: false, held: None };
    let (mut best, mut arm) = (Refined::at(state), 2);
    loop {
        if progress.cancelled() {
            return None;
        }
        // The longest arms decide; along what the patterns hardly tell, that takes more steps.
        let (seeds, count) = if arm >= last { (&all, 20) } else { (&few, 6) };
        best = refine(t, finest.level, seeds, best.state, Steps { arm: arm.min(last), count, ..how });
        if arm >= last {
            break;
        }
        arm *= 2;
    }
    if let Some(nearer) =
        nearest_to_camera(t, &best, |held| refine(t, finest.level, &all, held.at, Steps { held: Some(held), ..how }))
    {
        best = nearer;
    }
    best.scale.is_finite().then_some(best)
}

/// Returns those of some states that differ from all before them: most starts end in the same place.
fn different(states: Vec<State>) -> Vec<State> {
    /// Largest difference of what is the same.
    const SAME: f64 = 1e-3;
    let mut kept: Vec<State> = Vec::new();
    for s in states {
        if kept.iter().all(|k| (0..3).any(|i| (k[i] - s[i]).abs() > SAME)) {
            kept.push(s);
        }
    }
    tracing::debug!(states = ?kept, "starts of the light");
    kept
}

/// Moves a center that codes along one axis leave open along its line, as near to the camera as the codewords do not
/// mind: anywhere on the line is as good, but what they leave open across it grows with the distance. `refine` refines
/// a state that is held along a direction. `None` where the codes tell the center, where it is near enough, or where
/// they do mind.
fn nearest_to_camera(t: &Transport<'_>, found: &Refined, refine: impl Fn(Held) -> Refined) -> Option<Refined> {
    /// How strongly.
    const STRENGTH: f64 = 3e-2;
    /// Part of the distance to the boards that is near enough.
    const NEAR: f64 = 0.1;
    let line = undetermined(t.chart, found)?;
    let from = t.chart.center(found.state).position()?;
    if line.dot(&from.coords).abs() < NEAR * t.chart.scale {
        return None;
    }
    // From the nearest point of the line outward.
    [1.0, 0.75, 0.5, 0.25].into_iter().find_map(|part| {
        let at = from - line * (part * line.dot(&from.coords));
        let (here, next) = (t.chart.state(&at)?, t.chart.state(&(at + line))?);
        let along = (Vector3::from(next) - Vector3::from(here)).normalize();
        let moved = refine(Held { at: here, along, strength: STRENGTH });
        tracing::debug!(part, state = ?moved.state, was = found.scale, scale = moved.scale, "nearer to the camera");
        (moved.scale <= MAX_WORSE * found.scale).then_some(moved)
    })
}

/// What the codes tell of the two tangents of the light's direction, whatever its distance.
fn of_tangents(found: &Refined) -> SymmetricEigen<f64, Const<2>> {
    let a = &found.information;
    let with_distance = a.fixed_view::<2, 1>(0, 2) * a.fixed_view::<1, 2>(2, 0) / a[(2, 2)].max(1e-12);
    (a.fixed_view::<2, 2>(0, 0) - with_distance).symmetric_eigen()
}

/// The direction of the state that codes along one axis leave open: the tangent that they hardly tell, and the inverse
/// distance that goes with it at equal codewords.
fn open_direction(found: &Refined) -> Vector3<f64> {
    let eigen = of_tangents(found);
    let v = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let a = &found.information;
    let kappa = -(a[(2, 0)] * v[0] + a[(2, 1)] * v[1]) / a[(2, 2)].max(1e-12);
    Vector3::new(v[0], v[1], kappa).normalize()
}

/// Ratio of the information on the light's two tangents below which the codes leave one of them open: its standard
/// deviation is more than three times the other's.
const MAX_OPEN_RATIO: f64 = 0.1;

/// Whether the codes vary along one axis only: of the light's direction, they hardly tell one tangent.
fn is_one_axis(found: &Refined) -> bool {
    let values = of_tangents(found).eigenvalues;
    tracing::debug!(?values, "information on the light's direction");
    values.min() < MAX_OPEN_RATIO * values.max()
}

/// Which views' codewords, carried to the other views, do not fit there, while those of most views do.
fn without_consensus(t: &Transport<'_>, found: &Refined) -> Vec<bool> {
    let (n, light) = (t.views.len(), t.chart.center(found.state));
    let levels = search_levels(t);
    let Some(finest) = levels.first() else { return vec![false; n] };
    let sums: Vec<Vec<(f64, usize)>> = (0..n)
        .into_par_iter()
        .map(|to| {
            let mut sums = vec![(0.0, 0); n];
            let mut r = vec![0.0; t.views.k];
            for seed in finest.seeds.iter().filter(|s| s.view != to) {
                if t.carry(finest.level, seed, &light, to, &mut r) {
                    let of = &mut sums[seed.view];
                    *of = (of.0 + disagreement(&r, finest.by_chance), of.1 + 1);
                }
            }
            sums
        })
        .collect();
    // Both ways; the half of the others that a view agrees with best.
    let pair = |i: usize, j: usize| {
        let (a, b) = (sums[i][j], sums[j][i]);
        (a.1 + b.1 >= 10).then(|| (a.0 + b.0) / (a.1 + b.1) as f64)
    };
    let scores: Vec<Option<f64>> = (0..n)
        .map(|i| {
            let mut of: Vec<f64> = (0..n).filter(|j| *j != i).filter_map(|j| pair(i, j)).collect();
            of.sort_by(f64::total_cmp);
            of.get(of.len().saturating_sub(1) / 2).copied()
        })
        .collect();
    let mut known: Vec<f64> = scores.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    tracing::debug!(?scores, "agreement of positions");
    let consensus = known.get(known.len() * 2 / 3).is_some_and(|s| *s < 0.6 * NO_CONSENSUS);
    let outlier = |s: &Option<f64>| consensus && s.is_some_and(|s| s > NO_CONSENSUS);
    let outliers: Vec<bool> = scores.iter().map(outlier).collect();
    let left = outliers.iter().filter(|o| !**o).count();
    if left >= 3 { outliers } else { vec![false; n] }
}

/// The direction of the line on which the center lies, if the codes vary along one axis only and hardly tell where on
/// it.
fn undetermined(chart: &Chart, found: &Refined) -> Option<Vector3<f64>> {
    if !is_one_axis(found) {
        return None;
    }
    let open = open_direction(found);
    let moved = |by: f64| {
        let state = Vector3::from(found.state) + by * open;
        chart.center(state.into()).position()
    };
    let (a, b) = (moved(-1e-3)?, moved(1e-3)?);
    Some((b - a).normalize())
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::super::placed_sweep::BoardPlane;
    use super::super::views::Level;
    use super::*;

    /// Views of boards held by hand under a light at `center` whose rays have the codeword `code(x, y)` at tangents x
    /// and y.
    fn views(
        camera: &Camera,
        poses: &[Isometry3<f64>],
        center: Point3<f64>,
        code: impl Fn(f64, f64) -> Vec<f32>,
    ) -> Views {
        let k = code(0.0, 0.0).len();
        let mut finest = Level::finest(camera, k, poses.len());
        let boards: Vec<_> =
            poses.iter().map(|p| BoardPlane::new(p, [-90.0, -70.0, 90.0, 70.0], None)).enumerate().collect();
        for (_, board) in &boards {
            let mut image = Vec::new();
            for i in 0..camera.n_pixels() {
                let dir = camera.ray([(i % camera.width) as f64, (i / camera.width) as f64]).dir;
                let values = board.hit(&dir).map(|t| {
                    let from = Point3::from(dir * t) - center;
                    code(from.x / from.z, from.y / from.z)
                });
                let usable = if values.is_some() { 1.0 } else { 0.0 };
                image.extend(values.unwrap_or_else(|| vec![0.0; k]));
                image.push(usable);
            }
            finest.images.push(image);
        }
        Views::new(k, boards, finest, &Vector3::z())
    }

    fn poses() -> Vec<Isometry3<f64>> {
        let tilts = [[0.2, -0.1, 0.0], [-0.25, 0.1, 0.05], [0.05, 0.3, 0.0], [0.1, -0.3, -0.05], [-0.1, 0.05, 0.1]];
        let places =
            [[5.0, 0.0, 760.0], [-10.0, 8.0, 640.0], [12.0, -6.0, 700.0], [0.0, 4.0, 735.0], [-4.0, -9.0, 668.0]];
        (0..5).map(|i| Isometry3::new(Vector3::from(places[i]), Vector3::from(tilts[i]))).collect()
    }

    /// Gray code of a tangent, 7 bits.
    fn gray(v: f64) -> impl Iterator<Item = f32> {
        let n = (((v + 0.6) / 1.2).clamp(0.0, 0.999) * 128.0) as u32;
        (0..7).map(move |bit| ((n ^ n >> 1) >> bit & 1) as f32)
    }

    #[test]
    fn starts_that_end_in_the_same_place_are_one() {
        let states = [[0.1, 0.2, 0.3], [0.1004, 0.2, 0.2998], [0.1, 0.21, 0.3], [0.1, 0.2101, 0.3]];
        assert_eq!(different(states.to_vec()), [states[0], states[2]]);
    }

    #[test]
    fn carried_codewords_have_the_slopes_of_differences() {
        let mut camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
        camera.distortion = nelu3d_scan::camera::Distortion::new(&[-0.2, 0.1, 1e-3, -2e-3, 0.0]).unwrap();
        let wave = |v: f64| (40.0 * v).sin() as f32;
        let views = views(&camera, &poses(), Point3::new(-60.0, 140.0, 55.0), |x, y| vec![wave(x), wave(y)]);
        let chart = Chart::new(Point3::new(5.0, -3.0, 700.0));
        let t = Transport { camera: &camera, views: &views, chart: &chart };
        let state = [-0.1, 0.2, 0.9];
        let at = |i: usize, h: f64| {
            let mut s = state;
            s[i] += h;
            chart.center(s)
        };
        const H: f64 = 1e-7;
        let (mut n, mut apart) = (0, 0);
        for level in &views.levels[..2] {
            for seed in seeds(&camera, &views, level, 2000) {
                let to = (seed.view + 1) % views.len();
                let mut rows = Vec::new();
                t.carry_with_slopes(level, &seed, (&chart.center(state), &chart.slopes(state)), to, &mut rows);
                let mut here = [0.0; 2];
                assert_eq!(t.carry(level, &seed, &chart.center(state), to, &mut here), !rows.is_empty());
                for i in 0..3 {
                    let (mut more, mut less) = ([0.0; 2], [0.0; 2]);
                    let both = t.carry(level, &seed, &at(i, H), to, &mut more)
                        && t.carry(level, &seed, &at(i, -H), to, &mut less);
                    for (c, row) in rows.iter().enumerate().filter(|_| both) {
                        assert_eq!(row.difference, here[c]);
                        let slope = (more[c] - less[c]) / (2.0 * H);
                        n += 1;
                        // Where the step crosses into the next pixel, there are two slopes.
                        apart += usize::from((row.there[i] - slope).abs() > 1e-5 * (1.0 + slope.abs()));
                    }
                }
            }
        }
        assert!(n > 10_000 && apart * 1000 < n, "{apart} of {n}");
    }

    #[test]
    fn slopes_here_and_there_are_the_same_under_the_right_light() {
        let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
        let center = Point3::new(-60.0, 140.0, 55.0);
        let wave = |v: f64| (20.0 * v).sin() as f32;
        let views = views(&camera, &poses(), center, |x, y| vec![wave(x), wave(y)]);
        let chart = Chart::new(Point3::new(5.0, -3.0, 700.0));
        let t = Transport { camera: &camera, views: &views, chart: &chart };
        let state = chart.state(&center).unwrap();
        let mut rows = Vec::new();
        for seed in seeds(&camera, &views, &views.levels[0], 4000) {
            let to = (seed.view + 1) % views.len();
            t.carry_with_slopes(&views.levels[0], &seed, (&chart.center(state), &chart.slopes(state)), to, &mut rows);
        }
        let both: Vec<_> = rows.iter().filter_map(|r| Some((r.there, r.here?))).collect();
        assert!(both.len() > 2000, "{}", both.len());
        for i in 0..3 {
            let sum = |f: &dyn Fn(f64, f64) -> f64| both.iter().map(|(t, h)| f(t[i], h[i])).sum::<f64>();
            let (there, here, product) = (sum(&|t, _| t * t), sum(&|_, h| h * h), sum(&|t, h| t * h));
            assert!(product > 0.99 * (there * here).sqrt(), "{i}: {there} {here} {product}");
            assert!((product / there - 1.0).abs() < 0.03, "{i}: {there} {here} {product}");
        }
    }

    #[test]
    fn a_few_boards_held_by_hand_tell_where_the_light_is() {
        let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
        let center = Point3::new(-60.0, 140.0, 55.0);
        let both = views(&camera, &poses(), center, |x, y| gray(x).chain(gray(y)).collect());
        let found = find_center(both, &camera, &Progress::none()).unwrap();
        let at = found.center.position().unwrap();
        assert!((at - center).norm() < 6.0 && found.center.line.is_none(), "{at}");
        assert!(found.without_consensus.is_empty());

        // Along one axis only: up to a line along y.
        let rows = views(&camera, &poses(), center, |x, _| gray(x).collect());
        let found = find_center(rows, &camera, &Progress::none()).unwrap();
        let (at, line) = (found.center.position().unwrap(), found.center.line.unwrap());
        assert!(line.y.abs() > 0.95, "{line}");
        let off = (at - center) - line * line.dot(&(at - center));
        assert!(off.norm() < 8.0, "{at} {line}");
        // Of that line, the point nearest to the camera.
        assert!(line.dot(&at.coords).abs() < 80.0, "{at} {line}");
    }

    #[test]
    fn a_position_that_does_not_fit_is_named() {
        let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
        let center = Point3::new(-60.0, 140.0, 55.0);
        let mut wrong = views(&camera, &poses(), center, |x, y| gray(x).chain(gray(y)).collect());
        // Taken for 40 mm nearer than it was.
        wrong.planes[2].1 -= 40.0;
        let position = wrong.positions[2];
        let found = find_center(wrong, &camera, &Progress::none()).unwrap();
        assert_eq!(found.without_consensus, [position]);
        let at = found.center.position().unwrap();
        assert!((at - center).norm() < 6.0, "{at}");
    }

    #[test]
    fn a_hand_before_a_board_is_left_out() {
        let camera = Camera::pinhole(240, 180, 800.0, 800.0, 119.5, 89.5);
        let center = Point3::new(-60.0, 140.0, 55.0);
        let code = |x: f64, y: f64| gray(x).chain(gray(y)).collect::<Vec<f32>>();
        let clean = views(&camera, &poses(), center, code);
        let k = clean.k;
        // 36 × 30 pixels of the second view show what the light throws 25 mm before the board.
        let mut with_hand = views(&camera, &poses(), center, code);
        let hidden = 1;
        let (normal, offset) = with_hand.planes[hidden];
        let is_hand = |x: usize, y: usize| (60..96).contains(&x) && (70..100).contains(&y);
        for i in (0..camera.n_pixels()).filter(|i| is_hand(i % 240, i / 240)) {
            let dir = camera.ray([(i % 240) as f64, (i / 240) as f64]).dir;
            let from = Point3::from(dir * (offset / normal.dot(&dir) - 25.0)) - center;
            with_hand.levels[0].images[hidden][i * (k + 1)..][..k]
                .copy_from_slice(&code(from.x / from.z, from.y / from.z));
        }
        let levels = with_hand.levels.len();
        let finest = with_hand.levels.swap_remove(0);
        let boards: Vec<_> = with_hand
            .positions
            .iter()
            .map(|p| (*p, BoardPlane::new(&poses()[*p], [-90.0, -70.0, 90.0, 70.0], None)))
            .collect();
        let with_hand = Views::new(k, boards, finest, &Vector3::z());
        assert_eq!(with_hand.levels.len(), levels);
        let position = with_hand.positions[hidden];

        let none = find_center(clean, &camera, &Progress::none()).unwrap();
        assert!(none.excluded.is_empty(), "{:?}", none.excluded.iter().map(|e| e.0).collect::<Vec<_>>());
        let found = find_center(with_hand, &camera, &Progress::none()).unwrap();
        assert_eq!(found.excluded.iter().map(|e| e.0).collect::<Vec<_>>(), [position]);
        let blocks = &found.excluded[0].1;
        let (mut inside, mut outside) = (0, 0);
        for i in (0..camera.n_pixels()).filter(|i| blocks.contains(i % 240, i / 240)) {
            let near = (50..106).contains(&(i % 240)) && (60..110).contains(&(i / 240));
            if is_hand(i % 240, i / 240) {
                inside += 1
            } else if !near {
                outside += 1
            }
        }
        assert!(inside > 36 * 30 * 9 / 10 && outside < 36 * 30 / 2, "{inside} {outside}");
    }
}
