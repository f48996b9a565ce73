//! The virtual camera: light to codes to files.

use std::io;
use std::path::Path;

use nelu3d_scan::Image;
use nelu3d_scan::image::{write_png8, write_png16};
use nelu3d_scan::output::create_dir;
use nelu3d_scan::rig::{Channels, LUMA};
use rayon::prelude::*;

use crate::light::{Illumination, LightSource};
use crate::random::{RandomPurpose, generator};
use crate::render::Renderer;
use crate::scene::VirtualScene;
use crate::sensor::Sensor;
use crate::spec::{CameraSpec, Spec};

/// A camera before a light source.
pub(crate) struct VirtualCamera<'a> {
    pub(crate) spec: &'a Spec,
    pub(crate) renderer: &'a Renderer,
    pub(crate) light: &'a LightSource,
    pub(crate) sensor: Sensor,
}

impl VirtualCamera<'_> {
    /// Captures all images of a shot and writes them into the folder `dir`, which is created.
    pub(crate) fn capture(
        &self,
        scene: &VirtualScene,
        frames: &[(Illumination, String)],
        shot: u64,
        dir: &Path,
    ) -> io::Result<()> {
        let shows: Vec<Illumination> = frames.iter().map(|f| f.0).collect();
        let images = self.renderer.render(scene, self.light, &shows, shot);
        let files: Vec<&str> = frames.iter().map(|f| f.1.as_str()).collect();
        self.read_out(images, &files, shot, dir)
    }

    /// Reads the sensor after each of a shot's images, given as light, and writes the codes into the folder `dir`.
    pub(crate) fn read_out(&self, mut images: Vec<Image>, files: &[&str], shot: u64, dir: &Path) -> io::Result<()> {
        create_dir(dir)?;
        let camera = &self.spec.camera;
        let channels = camera.channels().expect("checked with the spec");
        images.par_iter_mut().zip(files).enumerate().try_for_each(|(f, (image, file))| {
            let is_mono = camera.mono_images.iter().any(|name| name == file);
            if is_mono {
                *image = mono_light(image, camera);
            }
            let row_len = image.width * image.channels;
            image.data.par_chunks_mut(row_len).enumerate().for_each(|(y, row)| {
                let mut random = generator(self.spec.seed, RandomPurpose::Sensor, [shot, f as u64, y as u64]);
                for (i, v) in row.iter_mut().enumerate() {
                    let channel = match channels {
                        Channels::Mono => 0,
                        // The sensor's green, which is most of luma.
                        Channels::Rgb if is_mono => 1,
                        Channels::Rgb => i % 3,
                        Channels::Bayer(cell) => usize::from(cell[(y % 2) * 2 + i % 2]),
                    };
                    *v = self.sensor.read(*v, channel, &mut random);
                }
            });
            let write = if camera.bits <= 8 { write_png8 } else { write_png16 };
            write(&dir.join(file), image, camera.black_level, camera.saturation())
        })
    }
}

/// Returns what a camera in its mono mode collects, in the unit of its green: its codes are the luma of those of its
/// channels, however bright.
fn mono_light(image: &Image, camera: &CameraSpec) -> Image {
    let rates = camera.electrons_per_sec.rgb();
    let weights = [0, 1, 2].map(|c| LUMA[c] * (rates[c] / rates[1]) as f32);
    let luma = |p: &[f32]| p.iter().zip(weights).map(|(v, w)| v * w).sum();
    Image { channels: 1, data: image.data.chunks_exact(3).map(luma).collect(), ..*image }
}
