//! The light that a surface sends to the camera: what falls on it from the light source, and what other surfaces send it,
//! found by path tracing (Kajiya, SIGGRAPH 1986) with the light source looked for at every surface on the way.
//!
//! Transport is linear: a path weighs the light of every image alike, so that one path serves all images of a shot.

use nalgebra::{Point3, Vector3};

use crate::light::{Frame, Light};
use crate::random::mix;
use crate::scene::material::{Material, frame, sample_cosine};
use crate::scene::{Hit, Scene};
use crate::spec::InterreflectionSpec;

/// Places per ray at which light enters a translucent surface.
const ENTRIES: usize = 4;

/// The generalized golden ratio's powers: multiples of it, mod 1, fill the unit square evenly in any number (Roberts, The
/// Unreasonable Effectiveness of Quasirandom Sequences, 2018).
const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// Which ray of which pixel: where its random numbers come from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// A hash of the pixel.
    pub(super) pixel: u64,
    /// Number of the ray in its pixel.
    pub(super) sample: usize,
}

/// A scene in its light.
pub(super) struct Transport<'a> {
    scene: &'a Scene,
    light: &'a Light,
    frames: &'a [Frame],
    ambient: f32,
    bounces: usize,
    /// Per ray.
    paths: usize,
    /// Memory to use again.
    scratch: Vec<f32>,
    irradiance: Vec<[f32; 3]>,
    radiance: Vec<[f32; 3]>,
}

impl<'a> Transport<'a> {
    /// `rays`: per pixel.
    pub(super) fn new(
        scene: &'a Scene,
        light: &'a Light,
        frames: &'a [Frame],
        ambient: f32,
        interreflection: InterreflectionSpec,
        rays: usize,
    ) -> Self {
        Self {
            scene,
            light,
            frames,
            ambient,
            bounces: if scene.interreflects() { interreflection.bounces } else { 0 },
            paths: interreflection.paths_per_pixel.div_ceil(rays),
            scratch: Vec::new(),
            irradiance: vec![[0.0; 3]; frames.len()],
            radiance: vec![[0.0; 3]; frames.len()],
        }
    }

    /// Light in red, green and blue that leaves a surface in the direction `out` in every frame: albedo times irradiance,
    /// where the surface is diffuse.
    pub(super) fn radiance(&mut self, hit: &Hit, out: &Vector3<f64>, place: Place) -> &[[f32; 3]] {
        self.radiance.fill([0.0; 3]);
        if let Material::Translucent { mean_free_path, share } = *self.scene.material(hit) {
            self.add_direct(hit, out, [1.0 - share as f32; 3]);
            let albedo = self.scene.albedo(hit);
            for i in 0..ENTRIES {
                let u = evenly(place.pixel ^ 0x5ca7, place.sample * ENTRIES + i);
                let entry = self.scene.beside(hit, mean_free_path, u);
                self.add_diffuse(&entry, albedo.map(|a| a * share as f32 / ENTRIES as f32));
            }
        } else {
            self.add_direct(hit, out, [1.0; 3]);
        }
        if self.bounces > 0 {
            for i in 0..self.paths {
                self.add_path(hit, out, place.pixel, place.sample * self.paths + i);
            }
        }
        &self.radiance
    }

    /// A path from the surface by way of others, as one of all from a pixel.
    fn add_path(&mut self, hit: &Hit, out: &Vector3<f64>, pixel: u64, index: usize) {
        let mut random = Stream(mix(pixel ^ mix(index as u64)));
        let mut weight = [1.0 / self.paths as f32; 3];
        let (mut hit, mut out) = (*hit, *out);
        // Only the first direction is spread evenly over a pixel's paths: it matters most.
        let mut u = evenly(pixel, index);
        for _ in 0..self.bounces {
            let Some((dir, reflectance)) = self.sample(&mut hit, &out, u, &mut random) else { return };
            for (w, r) in weight.iter_mut().zip(reflectance) {
                *w *= r;
            }
            if weight.iter().all(|w| *w == 0.0) {
                return;
            }
            let Some(next) = self.scene.next(&hit, dir) else { return };
            (hit, out) = (next, -dir);
            self.add_direct(&hit, &out, weight);
            u = [random.next(), random.next()];
        }
    }

    /// A direction from which light comes that leaves in the direction `out`, and which part of that light does; `hit`
    /// moves to where it enters.
    fn sample(
        &self,
        hit: &mut Hit,
        out: &Vector3<f64>,
        u: [f64; 2],
        random: &mut Stream,
    ) -> Option<(Vector3<f64>, [f32; 3])> {
        let albedo = self.scene.albedo(hit);
        match self.scene.material(hit) {
            Material::Lambert => Some((frame(&hit.normal) * sample_cosine(u), albedo)),
            Material::Translucent { mean_free_path, share } => {
                if random.next() < *share {
                    *hit = self.scene.beside(hit, *mean_free_path, [random.next(), random.next()]);
                }
                Some((frame(&hit.normal) * sample_cosine(u), albedo))
            }
            Material::Glossy(gloss) => {
                let basis = frame(&hit.normal);
                let out = basis.transpose() * out;
                // As often each part as it reflects of even light.
                let lacquer = gloss.reflected(out.z);
                let ground = (1.0 - lacquer) * f64::from(albedo.iter().copied().fold(0.0, f32::max));
                let choice = lacquer / (lacquer + ground).max(1e-12);
                if random.next() < choice {
                    let (dir, part) = gloss.sample_facets(&out, u)?;
                    Some((basis * dir, [(part / choice) as f32; 3]))
                } else {
                    let dir = sample_cosine(u);
                    let part = gloss.ground(out.z, dir.z) / (1.0 - choice);
                    Some((basis * dir, albedo.map(|a| a * part as f32)))
                }
            }
        }
    }

    /// Adds what the surface sends in the direction `out` of the light that reaches it straight, times `weight`.
    fn add_direct(&mut self, hit: &Hit, out: &Vector3<f64>, weight: [f32; 3]) {
        let albedo = self.scene.albedo(hit);
        let Material::Glossy(gloss) = self.scene.material(hit) else {
            return self.add_diffuse(hit, std::array::from_fn(|c| weight[c] * albedo[c]));
        };
        // A light source asks about the places its light comes from, the flash's first: those are the lamps.
        let lamps = std::cell::Cell::new([None::<Point3<f64>>; 2]);
        let lit = self.light.lit(&hit.point, &hit.normal, |to| {
            let [first, _] = lamps.get();
            lamps.set([first.or(Some(*to)), Some(*to)]);
            self.scene.sees(hit, to)
        });
        self.light.irradiance(self.frames, &lit, &mut self.scratch, &mut self.irradiance);
        let to_local = frame(&hit.normal).transpose();
        let out = to_local * out;
        // Of the flash and of the pattern's light. A lamp that gives no light here is not asked about, and does not matter.
        let reflectance = lamps.get().map(|lamp| {
            let Some(lamp) = lamp else { return [0.0; 3] };
            let to = to_local * (lamp - hit.point).normalize();
            let (lacquer, ground) = (gloss.facets(&out, &to), gloss.ground(out.z, to.z));
            albedo.map(|a| lacquer as f32 + a * ground as f32)
        });
        let lacquer = gloss.reflected(out.z) as f32;
        let ambient = albedo.map(|a| (lacquer + a * (1.0 - lacquer)) * self.ambient);
        for ((sum, irradiance), shown) in self.radiance.iter_mut().zip(&self.irradiance).zip(self.frames) {
            let reflectance = reflectance[usize::from(*shown != Frame::White)];
            for c in 0..3 {
                sum[c] += weight[c] * (reflectance[c] * irradiance[c] + ambient[c]);
            }
        }
    }

    /// Adds the light that reaches a surface straight, ambient light too, times `weight`.
    fn add_diffuse(&mut self, hit: &Hit, weight: [f32; 3]) {
        let lit = self.light.lit(&hit.point, &hit.normal, |to| self.scene.sees(hit, to));
        self.light.irradiance(self.frames, &lit, &mut self.scratch, &mut self.irradiance);
        for (sum, irradiance) in self.radiance.iter_mut().zip(&self.irradiance) {
            for c in 0..3 {
                sum[c] += weight[c] * (irradiance[c] + self.ambient);
            }
        }
    }
}

/// The point `index` of a sequence that fills the unit square evenly, shifted by the pixel (Cranley and Patterson, 1976).
fn evenly(pixel: u64, index: usize) -> [f64; 2] {
    let mut shift = Stream(pixel);
    R2.map(|step| (shift.next() + index as f64 * step).fract())
}

/// SplitMix64's random numbers in `[0, 1)`.
struct Stream(u64);

impl Stream {
    fn next(&mut self) -> f64 {
        self.0 = mix(self.0);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}
