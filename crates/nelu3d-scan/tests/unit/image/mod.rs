//! Round trips through files of every kind, and every complaint about a file.

mod apng;
mod bayer;
mod bilinear;
mod box_mean;
mod gaussian_blur;
mod response;

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use nelu3d_scan::Image;
use nelu3d_scan::image::{
    Channels, ImageFileError, decode, decode_bytes, read_any, write_png8, write_png16, write_rgb8,
};

const W: usize = 7;
const H: usize = 5;

/// Codes that use the whole range.
fn code(i: usize, max: f64) -> f64 {
    (i as f64 * 0.618_034).fract() * max
}

fn image_of_codes(channels: usize, max: f64) -> Image {
    let mut image = Image::new(W, H, channels);
    for (i, v) in image.data.iter_mut().enumerate() {
        *v = (code(i, max).floor() / max) as f32;
    }
    image
}

fn read(path: &Path, channels: Channels, black: f64, saturation: f64) -> Result<Image, ImageFileError> {
    decode(path, Some((W, H)))?.linearize(path, channels, black, saturation)
}

fn complaint(path: &Path, channels: Channels, saturation: f64) -> String {
    let message = read(path, channels, 0.0, saturation).unwrap_err().to_string();
    assert!(message.contains(&path.file_name().unwrap().to_string_lossy().into_owned()), "file not named: {message}");
    message
}

fn write_tiff<C: ::tiff::encoder::colortype::ColorType>(path: &Path, data: &[C::Inner])
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let mut file = Cursor::new(Vec::new());
    ::tiff::encoder::TiffEncoder::new(&mut file).unwrap().write_image::<C>(W as u32, H as u32, data).unwrap();
    fs::write(path, file.into_inner()).unwrap();
}

fn write_exr(path: &Path, names: &[&str], data: &[f32]) {
    use ::exr::prelude::*;
    let n = names.len();
    let channels = names
        .iter()
        .enumerate()
        .map(|(c, name)| AnyChannel::new(*name, FlatSamples::F32((0..W * H).map(|i| data[i * n + c]).collect())));
    let layer = Layer::new(
        (W, H),
        LayerAttributes::default(),
        Encoding::SMALL_FAST_LOSSLESS,
        AnyChannels::sort(channels.collect()),
    );
    let mut file = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
    fs::write(path, file.into_inner()).unwrap();
}

/// One valid file of every kind, with what the sensor's channels are and the exact linear image.
fn all_kinds(dir: &Path) -> Vec<(PathBuf, Channels, f64, Image)> {
    use ::tiff::encoder::colortype::{Gray8, Gray16, Gray32Float, RGB8, RGB16, RGB32Float};
    let mut all = Vec::new();
    for channels in [Channels::Mono, Channels::Rgb] {
        let n = channels.count();
        let (a, b) = (image_of_codes(n, 255.0), image_of_codes(n, 65535.0));
        let codes8: Vec<u8> = a.data.iter().map(|v| (v * 255.0).round() as u8).collect();
        let codes16: Vec<u16> = b.data.iter().map(|&v| (f64::from(v) * 65535.0).round() as u16).collect();
        let path = |kind: &str| dir.join(format!("{}-{kind}", channels.name()));

        write_png8(&path("8.png"), &a, 0.0, 255.0).unwrap();
        write_png16(&path("16.png"), &b, 0.0, 65535.0).unwrap();
        if n == 1 {
            write_tiff::<Gray8>(&path("8.tif"), &codes8);
            write_tiff::<Gray16>(&path("16.tif"), &codes16);
            write_tiff::<Gray32Float>(&path("float.tif"), &a.data);
            write_exr(&path("float.exr"), &["Y"], &a.data);
        } else {
            write_tiff::<RGB8>(&path("8.tif"), &codes8);
            write_tiff::<RGB16>(&path("16.tif"), &codes16);
            write_tiff::<RGB32Float>(&path("float.tif"), &a.data);
            write_exr(&path("float.exr"), &["R", "G", "B"], &a.data);
        }
        for kind in ["8.png", "8.tif"] {
            all.push((path(kind), channels, 255.0, a.clone()));
        }
        for kind in ["16.png", "16.tif"] {
            all.push((path(kind), channels, 65535.0, b.clone()));
        }
        for kind in ["float.tif", "float.exr"] {
            all.push((path(kind), channels, 1.0, a.clone()));
        }
    }
    all
}

#[test]
fn every_kind_of_file_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    for (path, channels, saturation, expected) in all_kinds(dir.path()) {
        let image = read(&path, channels, 0.0, saturation).unwrap();
        assert_eq!((image.width, image.height, image.channels), (W, H, expected.channels));
        assert_eq!(read_any(&path).unwrap(), image, "full scale is that of the file here");
        for (i, (a, b)) in image.data.iter().zip(&expected.data).enumerate() {
            assert!((a - b).abs() < 1e-7, "{}: value {i} is {a}, not {b}", path.display());
        }
    }
}

#[test]
fn black_level_and_saturation_are_applied() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let mut image = Image::new(W, H, 1);
    image.data[..5].copy_from_slice(&[0.0, 0.5, 1.0, 1.2, -0.01]);
    write_png16(&path, &image, 64.0, 4095.0).unwrap();
    let back = read(&path, Channels::Mono, 64.0, 4095.0).unwrap();
    for (a, b) in back.data.iter().zip(&image.data) {
        assert!((a - b).abs() < 0.51 / 4031.0, "{a} is not {b}");
    }
    assert!(back.data[2] >= 1.0 && back.data[1] < 1.0 && back.data[4] < 0.0);
    // Floats are shifted and scaled in the same way.
    let path = dir.path().join("a.exr");
    write_exr(&path, &["Y"], &[3.0; W * H]);
    assert!(read(&path, Channels::Mono, 1.0, 5.0).unwrap().data.iter().all(|&v| v == 0.5));
}

#[test]
fn a_mosaic_becomes_color() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    write_png16(&path, &Image { data: vec![0.5; W * H], ..Image::new(W, H, 1) }, 0.0, 1000.0).unwrap();
    let image = read(&path, Channels::Bayer([0, 1, 1, 2]), 0.0, 1000.0).unwrap();
    assert_eq!(image.channels, 3);
    assert!(image.data.iter().all(|v| (v - 0.5).abs() < 1e-6));
}

#[test]
fn channel_mixups_are_explained() {
    let dir = tempfile::tempdir().unwrap();
    let (gray, color, fake) = (dir.path().join("gray.png"), dir.path().join("color.png"), dir.path().join("fake.png"));
    write_png8(&gray, &image_of_codes(1, 255.0), 0.0, 255.0).unwrap();
    write_png8(&color, &image_of_codes(3, 255.0), 0.0, 255.0).unwrap();
    write_rgb8(&fake, W, H, &[7; W * H * 3]).unwrap();
    assert!(
        complaint(&gray, Channels::Rgb, 255.0).contains("has one channel, but rig.toml says camera.channels = \"rgb\"")
    );
    for channels in [Channels::Mono, Channels::Bayer([1, 0, 2, 1])] {
        let e = complaint(&color, channels, 255.0);
        assert!(e.contains("has three channels") && e.contains(&channels.name()), "{e}");
    }
    let e = complaint(&fake, Channels::Mono, 255.0);
    assert!(e.contains("its three channels are equal: save it with one"), "{e}");
}

#[test]
fn unusable_files_are_explained() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let good = path("good.png");
    write_png8(&good, &image_of_codes(1, 255.0), 0.0, 255.0).unwrap();

    assert!(complaint(&path("none.png"), Channels::Mono, 255.0).contains("there is no such image"));
    fs::write(path("empty.png"), []).unwrap();
    assert!(complaint(&path("empty.png"), Channels::Mono, 255.0).contains("it is empty"));
    fs::write(path("photo.jpg"), [0xff, 0xd8, 0xff, 0xe0, 0, 0]).unwrap();
    assert!(complaint(&path("photo.jpg"), Channels::Mono, 255.0).contains("truncated or damaged"));
    fs::write(path("notes.png"), b"no image").unwrap();
    assert!(complaint(&path("notes.png"), Channels::Mono, 255.0).contains("neither PNG, TIFF, OpenEXR nor JPEG"));
    // A symbolic link that became text, as Git leaves it where there are none; and one that leads nowhere.
    fs::create_dir(path("scene")).unwrap();
    fs::write(path("scene/linked.png"), b"../good.png").unwrap();
    assert_eq!(decode(&path("scene/linked.png"), None).unwrap().data, decode(&good, None).unwrap().data);
    fs::write(path("scene/lost.png"), b"../gone.png").unwrap();
    let e = complaint(&path("scene/lost.png"), Channels::Mono, 255.0);
    assert!(e.contains("lost.png: it is a link that was copied as text, to ") && e.contains("gone.png, which"), "{e}");
    fs::create_dir(path("folder.png")).unwrap();
    assert!(
        complaint(&path("folder.png"), Channels::Mono, 255.0).contains("cannot be read: it is a folder; give a file")
    );
    #[cfg(unix)]
    {
        rustix::fs::mknodat(rustix::fs::CWD, path("pipe.png"), rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let e = complaint(&path("pipe.png"), Channels::Mono, 255.0);
        assert!(e.contains("it is a pipe, a socket or a device; give a regular file"), "{e}");
    }
    fs::File::create(path("huge.png")).unwrap().set_len(1 << 33).unwrap();
    assert!(complaint(&path("huge.png"), Channels::Mono, 255.0).contains("larger than the 268.4 MB that such a file"));
    let e = decode(&good, Some((640, 480))).unwrap_err().to_string();
    assert!(e.contains("good.png: is 7x5 pixels, but its intrinsics say 640x480"), "{e}");
    assert!(complaint(&good, Channels::Mono, 4095.0).contains("is 8-bit, so it never reaches the saturation of 4095"));

    let mut alpha = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut alpha, W as u32, H as u32);
    encoder.set_color(::png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&[0; 4 * W * H]).unwrap();
    fs::write(path("alpha.png"), alpha).unwrap();
    assert!(complaint(&path("alpha.png"), Channels::Rgb, 255.0).contains("alpha channel"));
    write_exr(&path("alpha.exr"), &["R", "G", "B", "A"], &[0.5; W * H * 4]);
    assert!(complaint(&path("alpha.exr"), Channels::Rgb, 1.0).contains("alpha channel"));
    write_exr(&path("odd.exr"), &["U", "V"], &[0.5; W * H * 2]);
    assert!(complaint(&path("odd.exr"), Channels::Rgb, 1.0).contains("has the channels U, V"));
    let mut data = [0.5; W * H];
    data[W + 2] = f32::NAN;
    write_exr(&path("nan.exr"), &["Y"], &data);
    assert!(complaint(&path("nan.exr"), Channels::Mono, 1.0).contains("holds NaN at pixel (2, 1)"));
}

#[test]
fn damaged_files_are_errors_and_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    for (path, channels, saturation, _) in all_kinds(dir.path()) {
        let whole = fs::read(&path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let read = |bytes: &[u8]| decode_bytes(&path, bytes, Some((W, H)))?.linearize(&path, channels, 0.0, saturation);
        // The last bytes of a TIFF may be padding or directory; half a file never is an image.
        for n in [0, 3, 8, 20, whole.len() / 3, whole.len() / 2] {
            let e = read(&whole[..n]).expect_err(&name).to_string();
            assert!(e.contains(&name), "{e}");
        }
        // Any byte may be wrong: the outcome is an image or an error.
        for i in 0..whole.len() {
            for flip in [0xff, 0x01, 0x80] {
                let mut bytes = whole.clone();
                bytes[i] ^= flip;
                let _ = read(&bytes);
                let _ = decode_bytes(&path, &bytes, None);
            }
        }
    }
}

#[test]
fn a_binned_image_is_that_of_larger_pixels_and_keeps_what_is_clipped() {
    let data = vec![0.1, 0.3, 0.5, 9.0, 0.2, 0.4, 1.0, 9.0, 9.0, 9.0, 9.0, 9.0];
    let image = Image { width: 4, height: 3, channels: 1, data };
    let binned = image.binned(2);
    assert_eq!((binned.width, binned.height), (2, 1));
    assert!((binned.data[0] - 0.25).abs() < 1e-6 && binned.data[1] == 9.0, "{:?}", binned.data);
    let colors = Image { width: 2, height: 2, channels: 3, data: (0..12).map(|i| i as f32 / 100.0).collect() };
    assert!(colors.binned(2).data.iter().zip([0.045, 0.055, 0.065]).all(|(a, b)| (a - b).abs() < 1e-6));
}
