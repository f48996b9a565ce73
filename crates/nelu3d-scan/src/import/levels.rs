//! The sensor's black level and saturation, from what the files say and from the codes in them.
//!
//! Cameras put 10 to 14 bits into 16 in two ways: right-aligned (codes to 4095) or left-aligned (multiples of 16, to
//! 65520). Chronos cameras do either, depending on the firmware and the format, and state a white level of 4095 in DNG.

use super::facts::Facts;
use crate::image::{Raw, RawData};

/// What the codes of a recording have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Codes {
    /// The largest code.
    pub max: u16,
    /// Every bit that is set in any code.
    pub bits: u16,
}

impl Codes {
    /// Returns what the codes of one image have in common; nothing for floating-point numbers.
    pub fn of(raw: &Raw) -> Self {
        match &raw.data {
            RawData::U8(v) => v.iter().fold(Self::default(), |s, &c| s.with(u16::from(c))),
            RawData::U16(v) => v.iter().fold(Self::default(), |s, &c| s.with(c)),
            RawData::Float(_) => Self::default(),
        }
    }

    fn with(self, code: u16) -> Self {
        self.and(Self { max: code, bits: code })
    }

    /// Returns what the codes of this and of other images have in common.
    pub fn and(self, other: Self) -> Self {
        Self { max: self.max.max(other.max), bits: self.bits | other.bits }
    }

    /// Returns the number of bits at the right that no code uses: 4 for 12 bits at the left of 16.
    fn shift(self) -> u32 {
        if self.bits == 0 { 0 } else { self.bits.trailing_zeros().min(6) }
    }
}

/// Black level and saturation, and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels {
    /// Sensor code for no light.
    pub black: f64,
    /// Sensor code at which a value is clipped.
    pub saturation: f64,
    /// Whether the levels are more than a guess.
    pub certain: bool,
    /// How they were found, for people.
    pub reason: String,
}

/// Returns the levels of a recording whose images are `like` this one, from what its files say and from the codes that
/// are used in all of it: codes that end at the left of their 16 bits are scaled as they are, whatever the files say.
pub fn of(like: &Raw, facts: &Facts, codes: Codes) -> Levels {
    let black = facts.black_level.unwrap_or(0.0);
    let from = |black, saturation, certain, reason: String| Levels { black, saturation, certain, reason };
    match &like.data {
        RawData::U8(_) if facts.white_level.is_none() => from(black, 255.0, true, "8-bit frames".into()),
        RawData::Float(_) => from(black, 1.0, false, "floating-point frames, taken to end at 1".into()),
        _ => {
            let (max, shift) = (f64::from(codes.max), codes.shift());
            let scale = f64::from(1u32 << shift);
            match facts.white_level {
                Some(white) if max > white && shift > 0 && max / scale <= white => {
                    let reason = format!(
                        "the frames say {white}, but their codes go to {max} in steps of {scale}: they are left-aligned"
                    );
                    from(black * scale, white * scale, true, reason)
                }
                Some(white) => from(black, white, true, "as the frames say".into()),
                None if shift > 0 => {
                    let reason = format!("codes go to {max} in steps of {scale}: {} bits, left-aligned", 16 - shift);
                    from(black, 65536.0 - scale, true, reason)
                }
                None => {
                    let bits = [12, 14, 16].into_iter().find(|b| max < f64::from(1u32 << b)).unwrap_or(16);
                    let reason = format!("a guess: codes go to {max}, so they are taken for {bits} bits");
                    from(black, f64::from((1u32 << bits) - 1), false, reason)
                }
            }
        }
    }
}
