//! The division of a sequence into keyframes' stretches and into parts that are computed separately.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// One of n parts of a sequence, written as `2/8`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Number of the part, from 1.
    pub index: usize,
    /// Number of parts.
    pub of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
        match parts {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index, of }),
            _ => Err("a part and their number, as 1/8 to 8/8".into()),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// A sequence of `frames` frames with a keyframe every `keyframe` frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Number of frames.
    pub frames: usize,
    /// Frames from one keyframe to the next; at least 1.
    pub keyframe: usize,
}

impl Plan {
    /// Returns whether a frame is a keyframe, which begins anew.
    pub fn is_key(&self, frame: usize) -> bool {
        frame.is_multiple_of(self.keyframe)
    }

    /// Returns the number of stretches, each of which begins with a keyframe.
    pub fn stretches(&self) -> usize {
        self.frames.div_ceil(self.keyframe)
    }

    /// Returns the frames of one part: whole stretches, as evenly as possible. Empty if there are more parts than
    /// stretches.
    pub fn part(&self, shard: Shard) -> Range<usize> {
        let edge = |i: usize| (i * self.stretches() / shard.of * self.keyframe).min(self.frames);
        edge(shard.index - 1)..edge(shard.index)
    }
}
