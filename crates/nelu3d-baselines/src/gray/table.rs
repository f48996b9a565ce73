//! Which columns a codeword names.

use std::collections::HashMap;

use nelu3d_scan::rig::PatternSet;

use crate::code::AxisCode;
use crate::error::DecodeError;

/// A table from codewords to columns. A codeword has a bit per image, of the first image the highest.
pub struct GrayTable {
    /// First and last column of every codeword that occurs.
    columns: Columns,
    /// Codeword of every column.
    pub words: Vec<u32>,
}

enum Columns {
    /// Indexed by codeword; `first > last` where it does not occur.
    Dense(Vec<[u16; 2]>),
    Sparse(HashMap<u32, [u16; 2]>),
}

impl GrayTable {
    /// Makes the table of one axis; `set` is named in messages.
    ///
    /// # Errors
    ///
    /// The images are no binary code, or two distant columns have the same codeword.
    pub fn new(code: &AxisCode, set: &PatternSet) -> Result<Self, DecodeError> {
        let unsuited = |problem: String, remedy: &str| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "gray",
            problem,
            remedy: remedy.into(),
        };
        let bits = code.lines.len();
        if bits > 32 || code.len() > usize::from(u16::MAX) {
            let problem = format!("it has {bits} images along one axis of {} px, and 32 bits are the most", code.len());
            return Err(unsuited(problem, "use setting `method` zncc"));
        }
        if let Some(line) = code.lines.iter().find(|l| l.values.iter().any(|v| (0.1..0.9).contains(v))) {
            let problem = format!("{} has values between black and white", line.path.display());
            return Err(unsuited(problem, "use setting `method` phase, mps or zncc"));
        }
        let words: Vec<u32> = (0..code.len())
            .map(|u| code.lines.iter().fold(0, |word, l| word << 1 | u32::from(l.values[u] > 0.5)))
            .collect();
        let mut columns =
            if bits <= 16 { Columns::Dense(vec![[1, 0]; 1 << bits]) } else { Columns::Sparse(HashMap::new()) };
        for (u, word) in words.iter().enumerate() {
            let u = u as u16;
            let known = match &mut columns {
                Columns::Dense(all) => &mut all[*word as usize],
                Columns::Sparse(all) => all.entry(*word).or_insert([1, 0]),
            };
            if known[0] > known[1] {
                *known = [u, u];
            } else if known[1] + 1 == u {
                known[1] = u;
            } else {
                let problem = format!("its columns {} and {u} have the same codeword", known[1]);
                return Err(unsuited(problem, "list the images of all bits in the set"));
            }
        }
        Ok(Self { columns, words })
    }

    /// Returns the first and last column of a codeword, `None` for one that does not occur. Columns side by side may
    /// share one.
    ///
    /// # Panics
    ///
    /// If the codeword has more bits than there are images.
    pub fn get(&self, word: u32) -> Option<[u16; 2]> {
        let found = match &self.columns {
            Columns::Dense(all) => all[word as usize],
            Columns::Sparse(all) => *all.get(&word)?,
        };
        (found[0] <= found[1]).then_some(found)
    }
}
