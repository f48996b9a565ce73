//! Images of a large sensor that are kept from one reading of a sweep to the next.

use std::collections::HashMap;
use std::sync::Mutex;

use nelu3d_scan::Image;

/// Most bytes that are kept: less than a fit of the field takes, before which they are gone.
const ROOM: usize = 80 << 20;
/// A value `v` is kept as the 16-bit code (v − `LEAST`) / `STEP`: far below any sensor's noise, and with room above 1 for
/// what is clipped.
const LEAST: f32 = -0.25;
const STEP: f32 = 2e-5;

/// The images of positions, reduced to blocks of the sensor's pixels, as far as there is room. At 31 megapixels a third of
/// a calibration's time went into decoding, and every file was decoded for each of two readings. What is kept is given
/// once: the second reading is the last one of most positions.
#[derive(Default)]
pub(super) struct KeptImages(Mutex<Kept>);

#[derive(Default)]
struct Kept {
    bytes: usize,
    /// The codes by the position's name, image by image; none until all are there, and once they were given.
    positions: HashMap<String, Option<Vec<u16>>>,
}

/// The images of a position that is being read, to be kept.
pub(super) struct Keeping<'a> {
    kept: &'a KeptImages,
    name: String,
    /// In one piece, which goes back to the system as a whole.
    codes: Vec<u16>,
}

impl KeptImages {
    /// Prepares to keep the images of a position, of `values` in all; `None` where they were kept before, or there is no
    /// room for them.
    pub(super) fn keeping(&self, name: &str, values: usize) -> Option<Keeping<'_>> {
        let mut kept = self.0.lock().expect("no reader panics");
        let bytes = values * size_of::<u16>();
        if kept.positions.contains_key(name) || kept.bytes + bytes > ROOM {
            return None;
        }
        kept.bytes += bytes;
        kept.positions.insert(name.into(), None);
        Some(Keeping { kept: self, name: name.into(), codes: Vec::with_capacity(values) })
    }

    /// Gives the images of a position, in the order in which they were read, if they are kept: of `width` and `height`
    /// pixels of `channels`.
    pub(super) fn give(
        &self,
        name: &str,
        [width, height, channels]: [usize; 3],
    ) -> Option<impl Iterator<Item = Image>> {
        let codes = self.0.lock().expect("no reader panics").positions.get_mut(name)?.take()?;
        let size = width * height * channels;
        Some((0..codes.len() / size).map(move |i| {
            let data = codes[i * size..][..size].iter().map(|code| f32::from(*code) * STEP + LEAST).collect();
            Image { width, height, channels, data }
        }))
    }
}

impl Keeping<'_> {
    /// Keeps the next image.
    pub(super) fn add(&mut self, image: &Image) {
        // What is clipped stays 1 or more, and what is not stays less.
        let most = (1.0 - LEAST) / STEP - 1.0;
        let code = |v: &f32| if *v < 1.0 { ((v - LEAST) / STEP).min(most).round() } else { f32::from(u16::MAX) };
        self.codes.extend(image.data.iter().map(|v| code(v) as u16));
    }

    /// Keeps the position, all images of which were read.
    pub(super) fn finish(self) {
        let mut kept = self.kept.0.lock().expect("no reader panics");
        kept.positions.insert(self.name, Some(self.codes));
    }
}
