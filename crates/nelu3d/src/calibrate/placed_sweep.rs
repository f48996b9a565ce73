//! A sweep whose board poses are known, so that every sample has a position in space.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use nelu3d_scan::Camera;
use nelu3d_scan::board::Board;
use nelu3d_scan::pose::Bend;
use rayon::prelude::*;

use super::drawn::{Drawn, DrawnSample};
use super::excluded::ExcludedBlocks;
use super::position::Position;
use super::relief::Relief;
use super::sweep::Sweep;
use crate::sensor::{Blur, NoiseModel};

/// A sweep with the poses of its boards: samples of (x, L), position by position.
pub struct PlacedSweep<'a> {
    /// Images of the sweep.
    pub sweep: Sweep<'a>,
    /// Plane of the board at each position.
    pub boards: Vec<BoardPlane>,
    /// Whether images do not tell which way around the board was held.
    pub(super) is_board_symmetric: bool,
    /// The camera of the pixels that are read: the sensor's, or blocks of them.
    pub camera: Camera,
    /// Noise of these pixels.
    pub noise: NoiseModel,
    /// How many times its variance in the dark the noise has in bright places; see [`NoiseEstimator::growth`].
    ///
    /// [`NoiseEstimator::growth`]: crate::sensor::NoiseEstimator::growth
    pub noise_growth: Option<f64>,
    /// Blur of the sensor's pixels.
    pub(super) sensor_blur: Blur,
    /// Blur of the pixels that are read.
    blur: Blur,
    /// Unit ray direction per pixel.
    pub dirs: Vec<Vector3<f64>>,
    /// Blocks of each position's image that are not used; none where all are.
    excluded: Vec<Option<ExcludedBlocks>>,
    /// What each position is judged by, of those that are.
    drawn: Vec<Option<Drawn>>,
}

/// Way from a pixel's middle up to which its light comes from the middle, px: noise of the contrast moves no sample.
const NEAR: f32 = 0.02;

/// What a pixel sees of a board: the point from which its light comes in the mean.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Unit direction from the camera.
    pub(super) dir: Vector3<f64>,
    /// Distance, mm.
    pub(super) t: f64,
}

/// The plane, bend and outline of a board, for intersection with rays from the camera.
#[derive(Clone, Copy, Debug)]
pub struct BoardPlane {
    /// Unit normal.
    pub normal: Vector3<f64>,
    /// Offset of the plane `normal · x = offset`, mm.
    pub offset: f64,
    origin: Vector3<f64>,
    /// Unit vectors along the board's x and y axes.
    pub axes: [Vector3<f64>; 2],
    extent_mm: [f64; 4],
    bend: Option<Bend>,
    /// Heights of its surface over its plane or bend, where codewords have told them.
    relief: Option<Relief>,
}

/// Steps toward the surface of a bent board. Each leaves a fraction of the error that is the product of the surface's
/// slope and the ray's: below 0.1 on any board that a detector still reads.
const SURFACE_STEPS: usize = 6;

impl BoardPlane {
    /// Places a board of outline `extent_mm` (x0, y0, x1, y1) at a pose.
    pub fn new(pose: &Isometry3<f64>, extent_mm: [f64; 4], bend: Option<Bend>) -> Self {
        let normal = pose.rotation * Vector3::z();
        let axes = [pose.rotation * Vector3::x(), pose.rotation * Vector3::y()];
        let origin = pose.translation.vector;
        Self { normal, offset: normal.dot(&origin), origin, axes, extent_mm, bend, relief: None }
    }

    /// Returns the motion that takes the board along the camera's rays by `mm` of (x/z, y/z), a linear function: its
    /// plane goes there, and what is in its middle stays on its ray.
    pub fn motion_along_rays(&self, mm: impl Fn([f64; 2]) -> f64) -> Isometry3<f64> {
        let [x0, y0, x1, y1] = self.extent_mm;
        let at = |x: f64, y: f64| self.origin + self.axes[0] * x + self.axes[1] * y;
        let moved = |p: Vector3<f64>| p + p.normalize() * mm([p.x / p.z, p.y / p.z]);
        let (x, y) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let (middle, right, below) = (moved(at(x, y)), moved(at(x1, y)), moved(at(x, y1)));
        let normal = (right - middle).cross(&(below - middle));
        let rotation = UnitQuaternion::rotation_between(&self.normal, &normal).unwrap_or_default();
        Isometry3::from_parts((middle - rotation * at(x, y)).into(), rotation)
    }

    /// Returns the middle and the corners of the outline, mm, in the camera's frame.
    pub(super) fn middle_and_corners(&self) -> [Point3<f64>; 5] {
        let [x0, y0, x1, y1] = self.extent_mm;
        let at = |x: f64, y: f64| Point3::from(self.origin + self.axes[0] * x + self.axes[1] * y);
        [at(0.5 * (x0 + x1), 0.5 * (y0 + y1)), at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)]
    }

    /// Moves the board.
    pub fn move_by(&mut self, motion: &Isometry3<f64>) {
        let turned = |v: &Vector3<f64>| motion.rotation * v;
        self.origin = motion.translation.vector + turned(&self.origin);
        self.normal = turned(&self.normal);
        self.axes = self.axes.map(|a| turned(&a));
        self.offset = self.normal.dot(&self.origin);
    }

    /// Returns the board's outline (x0, y0, x1, y1) in its own frame, mm.
    pub fn extent_mm(&self) -> [f64; 4] {
        self.extent_mm
    }

    /// Returns which point of the print, board coordinates in mm, is at a point of the board's surface.
    pub fn printed(&self, x: &Point3<f64>) -> [f64; 2] {
        let on = x.coords - self.origin;
        let at = [self.axes[0].dot(&on), self.axes[1].dot(&on)];
        self.bend.as_ref().map_or(at, |bend| bend.printed(at))
    }

    /// Returns the distance along a ray from the camera's center to the board, mm; `None` outside the board.
    #[inline]
    pub fn hit(&self, dir: &Vector3<f64>) -> Option<f64> {
        self.meet(dir).map(|(t, _)| t)
    }

    /// Returns where on its plane, mm, a ray from the camera's center meets the board, and the ray's slope against the
    /// plane: heights of the surface are met one over it further away. `None` outside the board.
    pub(super) fn hit_on_plane(&self, dir: &Vector3<f64>) -> Option<([f64; 2], f64)> {
        self.meet(dir).map(|(_, on_plane)| (on_plane, self.normal.dot(dir)))
    }

    /// Returns what the board's surface stands over its plane or bend, where codewords have told.
    pub(super) fn relief(&self) -> Option<&Relief> {
        self.relief.as_ref()
    }

    /// Adds heights to the board's surface.
    pub fn add_relief(&mut self, relief: &Relief) {
        self.relief.get_or_insert_with(|| Relief::flat(self.extent_mm)).add(relief);
    }

    /// Returns the distance along a ray from the camera's center to the board, mm, and where on its plane that is.
    #[inline]
    fn meet(&self, dir: &Vector3<f64>) -> Option<(f64, [f64; 2])> {
        let slope = self.normal.dot(dir);
        let mut t = self.offset / slope;
        if !(t.is_finite() && t > 0.0) {
            return None;
        }
        let on_board = |t: f64| {
            let on = dir * t - self.origin;
            [self.axes[0].dot(&on), self.axes[1].dot(&on)]
        };
        let mut on_plane = on_board(t);
        if self.bend.is_some() || self.relief.is_some() {
            for _ in 0..SURFACE_STEPS {
                let bent = self.bend.as_ref().map_or(0.0, |bend| bend.height(on_plane));
                let height = bent + self.relief.as_ref().map_or(0.0, |relief| relief.height(on_plane));
                t = (self.offset + height) / slope;
                on_plane = on_board(t);
            }
        }
        let [x, y] = self.bend.as_ref().map_or(on_plane, |bend| bend.printed(on_plane));
        let [x0, y0, x1, y1] = self.extent_mm;
        (x >= x0 && x <= x1 && y >= y0 && y <= y1).then_some((t, on_plane))
    }
}

impl<'a> PlacedSweep<'a> {
    /// Joins a sweep with the poses of its board, and the blur of the sensor's pixels.
    pub fn new(
        sweep: Sweep<'a>,
        poses: &[Isometry3<f64>],
        board: &Board,
        bend: Option<Bend>,
        sensor_blur: Blur,
    ) -> Self {
        assert_eq!(sweep.shots.len(), poses.len());
        let camera = sweep.camera();
        let w = camera.width;
        let dirs =
            (0..camera.n_pixels()).into_par_iter().map(|i| camera.ray([(i % w) as f64, (i / w) as f64]).dir).collect();
        let boards: Vec<_> = poses.iter().map(|p| BoardPlane::new(p, board.extent_mm, bend)).collect();
        let (excluded, drawn) = (vec![None; boards.len()], vec![None; boards.len()]);
        let noise = NoiseModel { read: 0.0, gain: 0.0, darkest: None };
        let blur = sensor_blur.of_blocks(sweep.binning);
        let is_board_symmetric = board.kind.is_symmetric();
        Self {
            sweep,
            boards,
            is_board_symmetric,
            camera,
            noise,
            noise_growth: None,
            sensor_blur,
            blur,
            dirs,
            excluded,
            drawn,
        }
    }

    /// Returns the noise of the sensor's pixels.
    pub(super) fn sensor_noise(&self) -> NoiseModel {
        let pixels = self.sweep.binning.pow(2) as f32;
        NoiseModel { read: self.noise.read * pixels, gain: self.noise.gain * pixels, ..self.noise }
    }

    /// Returns whether the outline of any board is in the image, lit or not.
    pub(super) fn is_in_view(&self) -> bool {
        self.boards.iter().any(|board| self.dirs.iter().any(|dir| board.hit(dir).is_some()))
    }

    /// Returns the number of positions.
    pub fn n_positions(&self) -> usize {
        self.boards.len()
    }

    /// Calls `f(pixel, seen, values, weights)` for every usable sample of a position.
    #[inline]
    pub fn for_each(&self, p: usize, position: &Position, mut f: impl FnMut(usize, Seen, &[f32], &[f32])) {
        let mut w = vec![0.0; self.sweep.k];
        self.for_each_usable(p, position, |i, seen| {
            if let Some(v) = position.sample(i, &self.noise, &mut w) {
                f(i, seen, v, &w);
            }
        });
    }

    /// Calls `f(pixel, seen)` for every usable sample of a position.
    #[inline]
    pub(super) fn for_each_usable(&self, p: usize, position: &Position, mut f: impl FnMut(usize, Seen)) {
        for i in (0..self.dirs.len()).filter(|i| position.is_usable(*i)) {
            if let Some(seen) = self.seen(p, i, position.log_gradient(i))
                && !self.is_excluded(p, i)
            {
                f(i, seen);
            }
        }
    }

    /// Returns what of the board at position `p` pixel `i` sees, by the gradient of the logarithm of the contrast there.
    #[inline]
    fn seen(&self, p: usize, i: usize, gradient: [f32; 2]) -> Option<Seen> {
        let mut dir = self.dirs[i];
        let [x, y] = self.blur.shift(gradient);
        if x * x + y * y > NEAR * NEAR {
            let along = |stride: usize| {
                let (before, after) = (i.checked_sub(stride).unwrap_or(i), (i + stride).min(self.dirs.len() - 1));
                (self.dirs[after] - self.dirs[before]) * 0.5
            };
            dir = (dir + along(1) * f64::from(x) + along(self.camera.width) * f64::from(y)).normalize();
        }
        self.boards[p].hit(&dir).map(|t| Seen { dir, t })
    }

    /// Drops positions, by index.
    pub(super) fn remove(&mut self, which: &[usize]) {
        let names: Vec<String> = which.iter().map(|p| self.sweep.shots[*p].name.clone()).collect();
        fn remove<T>(of_positions: &mut Vec<T>, which: &[usize]) {
            let mut is_kept = (0..of_positions.len()).map(|p| !which.contains(&p));
            of_positions.retain(|_| is_kept.next().expect("one answer per position"));
        }
        remove(&mut self.boards, which);
        remove(&mut self.excluded, which);
        remove(&mut self.drawn, which);
        self.sweep.retain(|name| !names.iter().any(|n| n == name));
    }

    /// Leaves blocks of the images of some positions, by index, out of all that follows.
    pub(super) fn exclude(&mut self, blocks: &[(usize, ExcludedBlocks)]) {
        for (p, blocks) in blocks {
            self.excluded[*p] = Some(blocks.clone());
        }
    }

    /// Keeps what a position is judged by.
    pub(super) fn keep_drawn(&mut self, p: usize, drawn: Drawn) {
        self.drawn[p] = Some(drawn);
    }

    /// Moves what positions are judged by to other memory: what was allocated between images that are gone by now keeps
    /// the memory of these from going back to the system (100 MB of the given rig `film`).
    pub(super) fn move_drawn(&mut self) {
        self.drawn = self.drawn.clone();
    }

    /// Returns what positions are judged by, and their indices.
    pub(super) fn drawn(&self) -> impl Iterator<Item = (usize, &Drawn)> {
        self.drawn.iter().enumerate().filter_map(|(p, drawn)| drawn.as_ref().map(|drawn| (p, drawn)))
    }

    /// Calls `f(sample, seen)` for every sample of `drawn`, which was drawn from position `p`, that lies on the board and
    /// is not left out.
    pub(super) fn for_each_drawn(&self, p: usize, drawn: &Drawn, mut f: impl FnMut(&DrawnSample<'_>, Seen)) {
        for sample in drawn.samples() {
            if let Some(seen) = self.seen(p, sample.pixel, sample.gradient)
                && !self.is_excluded(p, sample.pixel)
            {
                f(&sample, seen);
            }
        }
    }

    /// Returns whether pixel `i` of position `p` is left out.
    #[inline]
    fn is_excluded(&self, p: usize, i: usize) -> bool {
        let width = self.camera.width;
        self.excluded[p].as_ref().is_some_and(|blocks| blocks.contains(i % width, i / width))
    }

    /// Returns the mean point of the boards in the camera's view, mm.
    pub fn mean_point(&self) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        let mut n = 0.0;
        for board in &self.boards {
            for dir in self.dirs.iter().step_by((self.dirs.len() / 500).max(1)) {
                if let Some(t) = board.hit(dir) {
                    sum += dir * t;
                    n += 1.0;
                }
            }
        }
        if n > 0.0 { sum / n } else { Vector3::new(0.0, 0.0, 1.0) }
    }

    /// Returns the distances of the boards along the ray through [`Self::mean_point`], mm, position by position.
    pub(super) fn depths(&self) -> Vec<f64> {
        let dir = self.mean_point().normalize();
        self.boards.iter().map(|b| b.offset / b.normal.dot(&dir)).collect()
    }

    /// Returns the positions, by index, in the order of their [`Self::depths`].
    pub(super) fn in_depth_order(&self) -> Vec<usize> {
        let depths = self.depths();
        let mut order: Vec<usize> = (0..depths.len()).collect();
        order.sort_by(|a, b| depths[*a].total_cmp(&depths[*b]));
        order
    }

    /// Calls `f` for points of all boards, one for every seventh pixel.
    pub fn for_each_point(&self, mut f: impl FnMut(&Point3<f64>)) {
        for board in &self.boards {
            for dir in self.dirs.iter().step_by(7) {
                if let Some(t) = board.hit(dir) {
                    f(&Point3::from(dir * t));
                }
            }
        }
    }

    /// Returns the median distance between neighboring boards along the ray through [`Self::mean_point`], mm.
    pub fn typical_step_mm(&self) -> f64 {
        let mut t = self.depths();
        t.sort_by(f64::total_cmp);
        let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps[steps.len() / 2]
    }
}
