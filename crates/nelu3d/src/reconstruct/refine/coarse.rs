//! The refinement in a reduced image, from which that of the full one begins near its end: light fractions, the light
//! that surfaces throw on each other, and depth find each other in many steps, which are cheap there.

use std::borrow::Cow;

use nelu3d_scan::statistics::median;
use nelu3d_scan::{Camera, Image};
use rayon::prelude::*;

use super::settings::RefineSettings;
use crate::color_field::CameraRays;
use crate::reconstruct::initialize::InitialDepth;
use crate::reconstruct::maps::interpolate_within;
use crate::reconstruct::scene::Scene;
use crate::sensor::Measurements;
use crate::surface::PixelStatus;

/// Pixels of the surface from which most steps are in a reduced image. With fewer, pixels at outlines, where a reduced
/// one sees two surfaces, are too many: of 42,000, mean errors grow by a tenth.
const MIN_PIXELS: usize = 1_000_000;
/// Pixels that the reduced image may have.
const MANY_PIXELS: usize = 150_000;
/// Largest reduction.
const MAX_FACTOR: usize = 4;
/// Steps of depth from the initial surface within which that of the reduced image counts: at outlines, its pixels see
/// two surfaces.
pub const NEAR: f32 = 3.0;

/// Returns the factor by which the image is reduced; `None` where all steps are in the full one.
pub fn factor(initial: &InitialDepth, settings: &RefineSettings) -> Option<usize> {
    let n = initial.inv_z.iter().filter(|v| v.is_finite()).count();
    let is_enough = |f: &usize| n / (f * f) <= MANY_PIXELS || *f == MAX_FACTOR;
    (settings.fine_steps > 0 && n >= MIN_PIXELS).then(|| (2..=MAX_FACTOR).find(is_enough).expect("the last is enough"))
}

/// What a reduced image has of its own.
pub struct Reduced {
    /// Pixels of the full image along the side of one of its own.
    pub factor: usize,
    /// The camera of the reduced image.
    pub camera: Camera,
    /// The reduced white image.
    pub white: Image,
    /// The reduced measurements.
    pub measurements: Measurements,
    /// The reduced initial surface.
    pub initial: InitialDepth,
}

impl Reduced {
    /// Reduces a scene and its initial surface.
    pub(super) fn new(scene: &Scene<'_>, initial: &InitialDepth, factor: usize) -> Self {
        let mut measurements = scene.measurements.reduced(factor);
        let (w, width) = (measurements.width, scene.camera.width);
        // Means of two surfaces would be none: the middle one of the block's pixels.
        let middle = |i: usize| {
            let [x, y] = [i % w * factor, i / w * factor];
            let pixels = (y..y + factor).flat_map(|row| (x..x + factor).map(move |column| row * width + column));
            median(&mut pixels.map(|i| initial.inv_z[i]).filter(|v| v.is_finite()).collect::<Vec<_>>())
                .unwrap_or(f32::NAN)
        };
        let inv_z: Vec<f32> = (0..measurements.n()).into_par_iter().with_min_len(w).map(middle).collect();
        for (status, inv_z) in measurements.status.iter_mut().zip(&inv_z) {
            if *status == PixelStatus::Valid && inv_z.is_nan() {
                *status = PixelStatus::Ambiguous;
            }
        }
        let initial = InitialDepth { inv_z, step: initial.step };
        Self { factor, camera: scene.camera.binned(factor), white: scene.white.binned(factor), measurements, initial }
    }

    /// Returns the reduced scene and its initial surface.
    pub(super) fn scene<'a>(&'a self, of: &'a Scene<'_>) -> (Scene<'a>, &'a InitialDepth) {
        let lit = |i: usize| self.measurements.status[i] == PixelStatus::Valid;
        let scene = Scene {
            camera: &self.camera,
            part: of.part,
            field: of.field,
            white: Cow::Borrowed(&self.white),
            grid: Cow::Borrowed(&*of.grid),
            rays: CameraRays::of_lit(of.camera, of.field, self.factor, of.part.origin, lit),
            // That of a reduced image is small beside its pixels.
            blur: None,
            measurements: self.measurements.clone(),
        };
        (scene, &self.initial)
    }

    /// Returns a map of the reduced image as one of the full image, of the pixels that `initial` has: camera z, mm, or
    /// any that is smooth up to jumps beyond `max_difference`.
    pub(super) fn expanded(&self, map: &[f32], initial: &InitialDepth, width: usize, max_difference: f32) -> Vec<f32> {
        let (f, half) = (self.factor as f32, 0.5 * (self.factor as f32 - 1.0));
        let [w, h] = [self.measurements.width, self.measurements.height];
        let place = |at: usize, n: usize| ((at as f32 - half) / f).clamp(0.0, n as f32 - 1.0);
        let of = |i: usize| {
            if initial.inv_z[i].is_nan() {
                return f32::NAN;
            }
            interpolate_within(map, w, h, place(i % width, w), place(i / width, h), max_difference)
        };
        (0..initial.inv_z.len()).into_par_iter().with_min_len(width).map(of).collect()
    }

    /// Returns where the refinement of the full image begins: at the inverse depths found in the reduced one, 1/mm, and
    /// where these are far from the initial surface, there.
    pub fn start(&self, found: &[f32], initial: &InitialDepth, width: usize) -> InitialDepth {
        let step = initial.step;
        let mut inv_z = self.expanded(found, initial, width, NEAR * step);
        for (v, initial) in inv_z.iter_mut().zip(&initial.inv_z) {
            let is_near = (*v - initial).abs() <= NEAR * step;
            if !is_near {
                *v = *initial;
            }
        }
        InitialDepth { inv_z, step }
    }
}
