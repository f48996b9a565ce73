//! Damaged files: valid ones with a few changes, as bad disks, bad cables and bad programs make them.

use rand::RngExt;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

/// A number that a file may say of itself: more often than by chance one at which readers go wrong.
fn number(rng: &mut StdRng) -> u32 {
    let special = [0, 1, u32::MAX, i32::MAX as u32, 1 << 31, 1 << 20];
    match rng.random_range(0..8) {
        6 => rng.random_range(0..70_000),
        7 => rng.random(),
        i => special[i],
    }
}

/// Applies one to five changes to a file. Half of the places lie in its first 256 bytes, where headers are.
pub(crate) fn damaged(file: &[u8], rng: &mut StdRng) -> Vec<u8> {
    let mut bytes = file.to_vec();
    for k in 0..rng.random_range(1..6) {
        if bytes.is_empty() {
            break;
        }
        let n = if k % 2 == 0 { bytes.len().min(256) } else { bytes.len() };
        let at = rng.random_range(0..n);
        match rng.random_range(0..11) {
            // One byte becomes another.
            0..4 => bytes[at] = rng.random(),
            // Four bytes become a number, which is little-endian or not.
            4..8 => {
                let v = number(rng);
                let number = if rng.random() { v.to_be_bytes() } else { v.to_le_bytes() };
                bytes[at..].iter_mut().zip(number).for_each(|(b, v)| *b = v);
            }
            // Everything from here on is missing.
            8 => bytes.truncate(at),
            // Bytes are inserted.
            9 => {
                let more = random_bytes(rng, 1, 8);
                bytes.splice(at..at, more);
            }
            // Bytes are missing.
            _ => {
                let end = (at + rng.random_range(1..9)).min(bytes.len());
                bytes.drain(at..end);
            }
        }
    }
    bytes
}

/// Arbitrary bytes after one of several beginnings, which make a reader take them for its own.
pub(crate) fn arbitrary(beginnings: &[&[u8]], rng: &mut StdRng) -> Vec<u8> {
    let beginning = *beginnings.choose(rng).expect("a beginning");
    [beginning, &random_bytes(rng, 0, 399)].concat()
}

/// `least` to `most` bytes.
fn random_bytes(rng: &mut StdRng, least: usize, most: usize) -> Vec<u8> {
    (0..rng.random_range(least..=most)).map(|_| rng.random()).collect()
}
