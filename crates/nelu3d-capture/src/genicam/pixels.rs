//! Formats of pixels, by their numbers in the Pixel Format Naming Convention of the GenICam standard.

use nelu3d_scan::image::{Channels, Raw, RawData};

/// What the bytes of a frame mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PixelFormat {
    /// Its name among the entries of the feature PixelFormat.
    pub(super) name: &'static str,
    /// Its number in the leader of a frame.
    number: u32,
    /// Bits of a code; beyond 8 a code is two bytes, the lower one first.
    pub(super) bits: u32,
    /// Channels of a pixel, or the layout of its mosaic, as rig.toml has it.
    pub(super) channels: &'static str,
}

const fn format(name: &'static str, number: u32, bits: u32, channels: &'static str) -> PixelFormat {
    PixelFormat { name, number, bits, channels }
}

/// Formats that are read, those of more bits first: every one of them holds the sensor's codes as they are.
pub(super) const FORMATS: [PixelFormat; 24] = [
    format("Mono16", 0x0110_0007, 16, "mono"),
    format("BayerGR16", 0x0110_002e, 16, "bayer-grbg"),
    format("BayerRG16", 0x0110_002f, 16, "bayer-rggb"),
    format("BayerGB16", 0x0110_0030, 16, "bayer-gbrg"),
    format("BayerBG16", 0x0110_0031, 16, "bayer-bggr"),
    format("Mono14", 0x0110_0025, 14, "mono"),
    format("Mono12", 0x0110_0005, 12, "mono"),
    format("BayerGR12", 0x0110_0010, 12, "bayer-grbg"),
    format("BayerRG12", 0x0110_0011, 12, "bayer-rggb"),
    format("BayerGB12", 0x0110_0012, 12, "bayer-gbrg"),
    format("BayerBG12", 0x0110_0013, 12, "bayer-bggr"),
    format("Mono10", 0x0110_0003, 10, "mono"),
    format("BayerGR10", 0x0110_000c, 10, "bayer-grbg"),
    format("BayerRG10", 0x0110_000d, 10, "bayer-rggb"),
    format("BayerGB10", 0x0110_000e, 10, "bayer-gbrg"),
    format("BayerBG10", 0x0110_000f, 10, "bayer-bggr"),
    format("BayerGR8", 0x0108_0008, 8, "bayer-grbg"),
    format("BayerRG8", 0x0108_0009, 8, "bayer-rggb"),
    format("BayerGB8", 0x0108_000a, 8, "bayer-gbrg"),
    format("BayerBG8", 0x0108_000b, 8, "bayer-bggr"),
    format("Mono8", 0x0108_0001, 8, "mono"),
    format("RGB8", 0x0218_0014, 8, "rgb"),
    format("RGB8Packed", 0x0218_0014, 8, "rgb"),
    format("RGB16", 0x0230_0033, 16, "rgb"),
];

impl PixelFormat {
    /// Says whether a frame's leader names this format.
    #[cfg(feature = "usb3")]
    pub(super) fn is(self, number: u32) -> bool {
        self.number == number
    }

    /// Returns the format of a frame's leader.
    #[cfg(any(feature = "gige", test))]
    pub(super) fn of(number: u32) -> Option<Self> {
        FORMATS.into_iter().find(|f| f.number == number)
    }

    /// Returns the channels, as rig.toml has them.
    pub(super) fn channels(self) -> Channels {
        Channels::from_name(self.channels).expect("the table has names of rig.toml")
    }

    /// Returns the picture in a frame's bytes, whose rows have `padding` more bytes; `None` if there are too few, or no
    /// pixels at all.
    pub(super) fn picture(self, bytes: &[u8], [width, height]: [usize; 2], padding: usize) -> Option<Raw> {
        // Any number of rows without a pixel would be had from no bytes.
        if width == 0 {
            return None;
        }
        let channels = self.channels().in_file();
        let row = width * channels * if self.bits > 8 { 2 } else { 1 };
        let rows = || (0..height).map(|y| bytes.get(y * (row + padding)..)?.get(..row));
        let rows: Vec<&[u8]> = rows().collect::<Option<_>>()?;
        let data = if self.bits > 8 {
            let codes = rows.iter().flat_map(|row| row.as_chunks::<2>().0).map(|pair| u16::from_le_bytes(*pair));
            RawData::U16(codes.collect())
        } else {
            RawData::U8(rows.concat())
        };
        Some(Raw { width, height, channels, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_become_codes() {
        let mono12 = PixelFormat::of(0x0110_0005).unwrap();
        assert_eq!((mono12.name, mono12.bits, mono12.channels()), ("Mono12", 12, Channels::Mono));
        // Two rows of two codes with two bytes between them; the last row's padding may be missing.
        let bytes = [0xff, 0x0f, 0x01, 0x00, 9, 9, 0x00, 0x08, 0x02, 0x01];
        let raw = mono12.picture(&bytes, [2, 2], 2).unwrap();
        assert_eq!(raw.data, RawData::U16(vec![4095, 1, 2048, 258]));
        assert!(mono12.picture(&bytes, [2, 3], 2).is_none());
        assert!(mono12.picture(&bytes, [0, usize::MAX], 0).is_none());
        let rgb = PixelFormat::of(0x0218_0014).unwrap();
        assert_eq!(rgb.picture(&[1, 2, 3, 4, 5, 6], [2, 1], 0).unwrap().channels, 3);
        assert_eq!(PixelFormat::of(0x0210_0032), None);
        assert!(FORMATS.iter().all(|f| f.channels().name() == f.channels));
    }
}
