//! PNG, TIFF, OpenEXR and DNG.

use std::io::Cursor;
use std::path::Path;
use std::sync::LazyLock;

use nelu3d_scan::image::{Channels, Image, RawData, decode_bytes, write_png8, write_png16};
use nelu3d_scan::import::decode_dng;
use rand::RngExt;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

use super::mutation::{arbitrary, damaged};
use super::{cases, measured, watched};
use crate::import::dng::{Dng, chronos};

const W: usize = 7;
const H: usize = 5;

fn png(channels: usize, wide: bool, width: usize, height: usize, codes: &[u16]) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let full = if wide { 65535.0 } else { 255.0 };
    let data = codes.iter().map(|&c| (f64::from(c) / full) as f32).collect();
    let image = Image { width, height, channels, data };
    if wide { write_png16(&path, &image, 0.0, full) } else { write_png8(&path, &image, 0.0, full) }.unwrap();
    std::fs::read(path).unwrap()
}

fn tiff<C: tiff::encoder::colortype::ColorType>(width: usize, height: usize, data: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut file = Cursor::new(Vec::new());
    tiff::encoder::TiffEncoder::new(&mut file).unwrap().write_image::<C>(width as u32, height as u32, data).unwrap();
    file.into_inner()
}

fn exr(names: &[&str], compressed: bool, width: usize, height: usize, data: &[f32]) -> Vec<u8> {
    use exr::prelude::*;
    let n = names.len();
    let plane = |c: usize| FlatSamples::F32((0..width * height).map(|i| data[i * n + c]).collect());
    let channels = names.iter().enumerate().map(|(c, name)| AnyChannel::new(*name, plane(c))).collect();
    let encoding = if compressed { Encoding::SMALL_LOSSLESS } else { Encoding::UNCOMPRESSED };
    let layer = Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    let mut file = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
    file.into_inner()
}

/// Valid files of every kind.
static FILES: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
    use tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, RGB8, RGB16};
    let codes: Vec<u16> = (0..3 * W * H).map(|i| (i * 617 % 256) as u16).collect();
    let bytes: Vec<u8> = codes.iter().map(|&c| c as u8).collect();
    let floats: Vec<f32> = codes.iter().map(|&c| f32::from(c) / 255.0).collect();
    let n = W * H;
    vec![
        png(1, false, W, H, &codes[..n]),
        png(3, false, W, H, &codes),
        png(1, true, W, H, &codes[..n]),
        png(3, true, W, H, &codes),
        tiff::<Gray8>(W, H, &bytes[..n]),
        tiff::<RGB8>(W, H, &bytes),
        tiff::<Gray16>(W, H, &codes[..n]),
        tiff::<RGB16>(W, H, &codes),
        tiff::<Gray32Float>(W, H, &floats[..n]),
        exr(&["Y"], false, W, H, &floats[..n]),
        exr(&["Y"], true, W, H, &floats[..n]),
        exr(&["B", "G", "R"], true, W, H, &floats),
    ]
});

/// Valid DNG files of every kind.
static DNGS: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
    let codes: Vec<u16> = (0..W * H).map(|i| (i * 617 % 256) as u16).collect();
    let plain = chronos(W, H);
    [
        plain.clone(),
        Dng { bits: 12, rows_per_strip: 2, ..plain.clone() },
        Dng { bits: 10, big_endian: true, ..plain.clone() },
        Dng { tile: Some((4, 4)), child: true, ..plain.clone() },
        Dng { active: Some([1, 1, 4, 6]), black: vec![3, 4, 5, 6], ..plain.clone() },
        Dng { bits: 8, table: (0..256).map(|c| c * 3).collect(), ..plain },
    ]
    .iter()
    .map(|dng| dng.bytes(&codes))
    .collect()
});

fn read(bytes: &[u8], size: Option<(usize, usize)>) {
    if let Ok(raw) = watched(|| decode_bytes(Path::new("a"), bytes, size)) {
        let channels = if raw.channels == 3 { Channels::Rgb } else { Channels::Mono };
        let _ = watched(|| raw.linearize(Path::new("a"), channels, 0.0, 1.0));
    }
}

#[test]
fn damaged_images_are_refused_or_read() {
    cases(1500, |rng| {
        let file = damaged(FILES.choose(rng).expect("files"), rng);
        read(&file, rng.random::<bool>().then_some((W, H)));
    });
}

#[test]
fn damaged_dng_files_are_refused_or_read() {
    cases(1500, |rng| {
        let file = damaged(DNGS.choose(rng).expect("files"), rng);
        let _ = watched(|| decode_dng(Path::new("a.dng"), file.clone(), (W, H)));
        read(&file, None);
    });
}

#[test]
fn arbitrary_bytes_are_no_image() {
    cases(1500, |rng| {
        let beginnings: [&[u8]; 6] = [
            b"",
            b"\x89PNG\r\n\x1a\n",
            b"II\x2a\0\x08\0\0\0",
            b"MM\0\x2a\0\0\0\x08",
            b"II\x2b\0\x08\0\0\0",
            b"\x76\x2f\x31\x01\x02\0\0\0",
        ];
        let bytes = arbitrary(&beginnings, rng);
        read(&bytes, None);
        let _ = watched(|| decode_dng(Path::new("a.dng"), bytes.clone(), (W, H)));
    });
}

/// A color profile and texts that unpack to megabytes stand beside the pixels of an image that is read as usual.
#[test]
fn what_stands_beside_the_pixels_is_not_unpacked() {
    const UNPACKED: usize = 32 << 20;
    let text = "x".repeat(UNPACKED);
    let mut info = png::Info::with_size(W as u32, H as u32);
    info.icc_profile = Some(vec![0; UNPACKED].into());
    let mut file = Vec::new();
    let mut encoder = png::Encoder::with_info(&mut file, info).unwrap();
    encoder.add_ztxt_chunk("note".into(), text.clone()).unwrap();
    encoder.add_itxt_chunk("note".into(), text).unwrap();
    let codes: Vec<u8> = (0..W * H).map(|i| i as u8).collect();
    encoder.write_header().unwrap().write_image_data(&codes).unwrap();
    for size in [None, Some((W, H))] {
        let (raw, largest) = measured(|| decode_bytes(Path::new("a.png"), &file, size));
        assert_eq!(raw.unwrap().data, RawData::U8(codes.clone()));
        assert!(largest < UNPACKED / 4, "{largest} bytes were asked for at once");
    }
}

/// A small file that claims more pixels than any picture has is refused before they are unpacked.
#[test]
fn pixel_bombs_are_refused() {
    const SIDE: u32 = 16_000;
    let chunk = |name: &[u8], data: &[u8]| {
        let whole = [name, data].concat();
        let crc = (0..=255u32).map(|i| (0..8).fold(i, |c, _| (c >> 1) ^ (0xedb8_8320 * (c & 1)))).collect::<Vec<_>>();
        let sum = whole.iter().fold(!0u32, |c, b| crc[(c as u8 ^ b) as usize] ^ (c >> 8));
        [&(data.len() as u32).to_be_bytes()[..], &whole, &(!sum).to_be_bytes()].concat()
    };
    let header = [&SIDE.to_be_bytes()[..], &SIDE.to_be_bytes(), &[16, 2, 0, 0, 0]].concat();
    let pixels = [&[0x78, 0x9c][..], &vec![0; 60_000]].concat();
    let file = [&b"\x89PNG\r\n\x1a\n"[..], &chunk(b"IHDR", &header), &chunk(b"IDAT", &pixels)].concat();
    let (e, largest) = measured(|| decode_bytes(Path::new("a.png"), &file, None).unwrap_err().to_string());
    assert!(e.contains("would unpack to 1.5 GB; save it with fewer pixels"), "{e}");
    assert!(largest < 1 << 20, "{largest} bytes were asked for at once");
}

/// Sizes, and as many codes of one channel.
fn picture(rng: &mut StdRng) -> (usize, usize, usize, Vec<u16>) {
    let (w, h) = (rng.random_range(1..20), rng.random_range(1..20));
    let channels = *[1, 3].choose(rng).expect("some");
    (w, h, channels, (0..w * h * channels).map(|_| rng.random()).collect())
}

#[test]
fn codes_round_trip() {
    use tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, RGB8, RGB16, RGB32Float};
    cases(64, |rng| {
        let (w, h, channels, codes) = picture(rng);
        let read = |bytes: &[u8]| {
            let raw = decode_bytes(Path::new("a"), bytes, Some((w, h))).unwrap();
            assert_eq!((raw.width, raw.height, raw.channels), (w, h, channels));
            raw.data
        };
        let bytes: Vec<u8> = codes.iter().map(|&c| (c >> 8) as u8).collect();
        let wide: Vec<u16> = bytes.iter().map(|&b| b.into()).collect();
        // Any finite bits that are a float.
        let floats: Vec<f32> = codes.iter().map(|&c| f32::from(c) * 1.1e-5 - 0.01).collect();
        assert_eq!(read(&png(channels, false, w, h, &wide)), RawData::U8(bytes.clone()));
        assert_eq!(read(&png(channels, true, w, h, &codes)), RawData::U16(codes.clone()));
        let (eight, sixteen, float) = if channels == 1 {
            (tiff::<Gray8>(w, h, &bytes), tiff::<Gray16>(w, h, &codes), tiff::<Gray32Float>(w, h, &floats))
        } else {
            (tiff::<RGB8>(w, h, &bytes), tiff::<RGB16>(w, h, &codes), tiff::<RGB32Float>(w, h, &floats))
        };
        assert_eq!(read(&eight), RawData::U8(bytes));
        assert_eq!(read(&sixteen), RawData::U16(codes.clone()));
        assert_eq!(read(&float), RawData::Float(floats.clone()));
        let names: &[&str] = if channels == 1 { &["Y"] } else { &["R", "G", "B"] };
        assert_eq!(read(&exr(names, true, w, h, &floats)), RawData::Float(floats));
        if channels == 1 {
            let file = Dng { rows_per_strip: 3, cfa: None, photometric: 34892, ..chronos(w, h) }.bytes(&codes);
            let raw = decode_dng(Path::new("a.dng"), file, (w, h)).unwrap();
            assert_eq!(raw.data, RawData::U16(codes));
        }
    });
}
