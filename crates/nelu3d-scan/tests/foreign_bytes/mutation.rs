//! Damaged files: valid ones with a few changes, as bad disks, bad cables and bad programs make them.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

/// One change of a file.
#[derive(Clone, Debug)]
pub(crate) enum Change {
    /// One byte becomes another.
    Byte(Index, u8),
    /// Four bytes become a number, which is little-endian or not.
    Number(Index, u32, bool),
    /// Everything from here on is missing.
    Cut(Index),
    /// Bytes are inserted.
    Insert(Index, Vec<u8>),
    /// Bytes are missing.
    Remove(Index, usize),
}

fn change() -> impl Strategy<Value = Change> {
    let number = prop_oneof![
        Just(0),
        Just(1),
        Just(u32::MAX),
        Just(i32::MAX as u32),
        Just(1 << 31),
        Just(1 << 20),
        0u32..70_000,
        any::<u32>()
    ];
    prop_oneof![
        4 => (any::<Index>(), any::<u8>()).prop_map(|(i, b)| Change::Byte(i, b)),
        4 => (any::<Index>(), number, any::<bool>()).prop_map(|(i, n, e)| Change::Number(i, n, e)),
        1 => any::<Index>().prop_map(Change::Cut),
        1 => (any::<Index>(), vec(any::<u8>(), 1..9)).prop_map(|(i, b)| Change::Insert(i, b)),
        1 => (any::<Index>(), 1usize..9).prop_map(|(i, n)| Change::Remove(i, n)),
    ]
}

/// A few changes.
pub(crate) fn changes() -> impl Strategy<Value = Vec<Change>> {
    vec(change(), 1..6)
}

/// Applies changes to a file. Half of the places lie in its first 256 bytes, where headers are.
pub(crate) fn damaged(file: &[u8], changes: &[Change]) -> Vec<u8> {
    let mut bytes = file.to_vec();
    for (k, change) in changes.iter().enumerate() {
        if bytes.is_empty() {
            break;
        }
        let n = if k % 2 == 0 { bytes.len().min(256) } else { bytes.len() };
        match change {
            Change::Byte(i, b) => bytes[i.index(n)] = *b,
            Change::Number(i, v, big) => {
                let at = i.index(n);
                let number = if *big { v.to_be_bytes() } else { v.to_le_bytes() };
                bytes[at..].iter_mut().zip(number).for_each(|(b, v)| *b = v);
            }
            Change::Cut(i) => bytes.truncate(i.index(n)),
            Change::Insert(i, more) => {
                let at = i.index(n);
                bytes.splice(at..at, more.iter().copied());
            }
            Change::Remove(i, len) => {
                let at = i.index(n);
                let end = (at + len).min(bytes.len());
                bytes.drain(at..end);
            }
        }
    }
    bytes
}

/// Arbitrary bytes after one of several beginnings, which make a reader take them for its own.
pub(crate) fn arbitrary(beginnings: &'static [&'static [u8]]) -> impl Strategy<Value = Vec<u8>> {
    (0..beginnings.len(), vec(any::<u8>(), 0..400)).prop_map(move |(i, rest)| [beginnings[i], &rest].concat())
}
