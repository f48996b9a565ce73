//! What DNG files can be, and what their codes say about the sensor.

use nelu3d_scan::import::{Frame, SensorCodes, SensorFacts, decode_dng_with_facts, read_frame, sensor_levels};

use super::dng::Dng;
use super::*;

/// Writes one DNG and reads it.
fn read(dng: &Dng, codes: &[u16], size: (usize, usize)) -> Frame {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dng");
    fs::write(&path, dng.bytes(codes)).unwrap();
    read_frame(&path, size).unwrap()
}

#[test]
fn codes_survive_every_packing() {
    for big_endian in [false, true] {
        for (bits, width) in [(8, W), (10, W), (12, W), (12, 7), (14, 9), (16, W)] {
            let codes: Vec<u16> =
                codes(3).iter().take(width * H).map(|&c| c & ((1u32 << bits) - 1).min(0xffff) as u16).collect();
            let strips = Dng { bits, big_endian, ..chronos(width, H) };
            let tiles = Dng { tile: Some((4, 4)), ..strips.clone() };
            let rows = Dng { rows_per_strip: 4, ..strips.clone() };
            let child = Dng { child: true, ..strips.clone() };
            for dng in [strips, tiles, rows, child] {
                let frame = read(&dng, &codes, (width, H));
                assert_eq!(frame.raw.data, RawData::U16(codes.clone()), "{bits} bits, big endian: {big_endian}");
                assert_eq!(frame.facts.channels, Some(Channels::Bayer([1, 0, 2, 1])));
            }
        }
    }
}

#[test]
fn early_chronos_firmware_counts_rows_wrong() {
    // It writes the width as RowsPerStrip of its only strip.
    let tall: Vec<u16> = (0..5 * 12).collect();
    let dng = Dng { rows_per_strip: 12, ..chronos(5, 12) };
    let mut bytes = dng.bytes(&tall);
    let entry = bytes.windows(4).position(|w| w == [22, 1, 4, 0]).expect("tag 278, type 4");
    bytes[entry + 8] = 5;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dng");
    fs::write(&path, bytes).unwrap();
    assert_eq!(read_frame(&path, (5, 12)).unwrap().raw.data, RawData::U16(tall));
}

#[test]
fn facts_are_read() {
    let mono = Dng { photometric: 1, cfa: None, white: None, ..chronos(W, H) };
    let facts = read(&mono, &codes(0), (W, H)).facts;
    assert_eq!(facts, SensorFacts { channels: Some(Channels::Mono), black_level: None, white_level: None });
    let levels = Dng { black: vec![128, 129, 129, 130], white: Some(1023), ..chronos(W, H) };
    let facts = read(&levels, &codes(0), (W, H)).facts;
    assert_eq!((facts.black_level, facts.white_level), (Some(64.5), Some(1023.0)));
}

#[test]
fn masked_pixels_are_cut_off_and_tables_applied() {
    let active = Dng { active: Some([1, 2, 6, 9]), ..chronos(W, H) };
    let raw = read(&active, &codes(0), (7, 5)).raw;
    let all = codes(0);
    let expected: Vec<u16> = (1..6).flat_map(|y| all[y * W + 2..y * W + 9].to_vec()).collect();
    assert_eq!(raw.data, RawData::U16(expected));
    let table = Dng { bits: 8, table: (0..200).map(|i| i * 5).collect(), ..chronos(W, H) };
    let bytes: Vec<u16> = codes(0).iter().map(|c| c & 255).collect();
    let expected: Vec<u16> = bytes.iter().map(|&c| c.min(199) * 5).collect();
    assert_eq!(read(&table, &bytes, (W, H)).raw.data, RawData::U16(expected));
}

#[test]
fn levels_follow_the_alignment() {
    let levels = |codes: &[u16], white: Option<f64>, black: Option<f64>| {
        let raw = Raw { width: codes.len(), height: 1, channels: 1, data: RawData::U16(codes.to_vec()) };
        let facts = SensorFacts { channels: None, black_level: black, white_level: white };
        let l = sensor_levels(&raw, &facts, SensorCodes::of(&raw));
        (l.black, l.saturation, l.certain)
    };
    // Right-aligned, and said so.
    assert_eq!(levels(&[3, 4000], Some(4095.0), Some(64.0)), (64.0, 4095.0, true));
    // Left-aligned, whatever the file says.
    assert_eq!(levels(&[16, 48000], Some(4095.0), Some(64.0)), (1024.0, 65520.0, true));
    assert_eq!(levels(&[16, 48000], None, None), (0.0, 65520.0, true));
    // Codes above the white level are clipped.
    assert_eq!(levels(&[3, 4100], Some(4095.0), None), (0.0, 4095.0, true));
    // Nothing is said.
    assert_eq!(levels(&[3, 900], None, None), (0.0, 4095.0, false));
    assert_eq!(levels(&[3, 5000], None, None), (0.0, 16383.0, false));
    assert_eq!(levels(&[3, 50001], None, None), (0.0, 65535.0, false));
    assert_eq!(levels(&[0, 0], None, None), (0.0, 4095.0, false));
}

#[test]
fn broken_files_are_complaints() {
    let whole = Dng { child: true, active: Some([1, 2, 6, 9]), ..chronos(W, H) }.bytes(&codes(0));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.dng");
    let good = decode_dng_with_facts(&path, whole.clone(), (7, 5)).unwrap();
    for i in 0..whole.len() {
        // The last entry's padding and the end mark behind it say nothing that is needed.
        let cut = decode_dng_with_facts(&path, whole[..i].to_vec(), (7, 5));
        assert!(cut.is_err() || (i + 8 > whole.len() && cut.unwrap() == good), "cut at {i}");
        for flip in [0x01, 0x10, 0xff] {
            let mut bytes = whole.clone();
            bytes[i] ^= flip;
            // Good or bad, but it ends and does not panic.
            let _ = decode_dng_with_facts(&path, bytes, (7, 5));
        }
    }
}
