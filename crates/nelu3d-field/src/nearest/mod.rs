//! Nearest codewords: for each query, the position of the closest of its own row of candidates.
//!
//! A table holds one row per query: `[channel][position]`, each channel `stride` values long, positions contiguous so
//! that neighbors share a vector. It is stored whole ([`Codes::Full`]) or as per-channel products of two factors
//! ([`Codes::LowRank`]) whose entries are made while they are compared and never written anywhere.
//!
//! The distance of position p is Σ_j (c_jp − q_j)² over the channels j whose query is a number. A candidate that is NaN
//! is never chosen; of equal ones the first is. Runs on the calling thread: the caller cuts the table.

pub mod cpu;
pub mod reference;

/// `stride` must be a multiple of this; positions from `n_positions` on are padding.
pub const LANES: usize = 8;

/// The closest candidate of one query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Its position; `u32::MAX` when there was no candidate.
    pub index: u32,
    /// Sum of squared differences; infinite when there was no candidate.
    pub distance: f32,
}

impl Hit {
    /// No candidate.
    pub const NONE: Self = Self { index: u32::MAX, distance: f32::INFINITY };
}

/// Sizes of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Channels of a codeword.
    pub n_channels: usize,
    /// Positions that are candidates.
    pub n_positions: usize,
    /// Positions in memory, a multiple of [`LANES`].
    pub stride: usize,
}

/// The candidates of some queries.
#[derive(Clone, Copy, Debug)]
pub enum Codes<'a> {
    /// All of them.
    Full {
        /// `[query][row_len]`, of which the first `n_channels · stride` are `[channel][position]`.
        data: &'a [f32],
        /// Values of one query's row.
        row_len: usize,
    },
    /// Σ_i left_ji · right_jip for channel j, position p.
    LowRank {
        /// `[query][row_len]`, of which the first `n_channels · rank` are `[channel][rank]`.
        left: &'a [f32],
        /// Values of one query's row of `left`.
        row_len: usize,
        /// `[channel][rank][stride]`.
        right: &'a [f32],
        /// Terms of the sum.
        rank: usize,
    },
}

impl Codes<'_> {
    fn check(&self, shape: Shape, queries: &[f32], ranges: Option<&[[u32; 2]]>, hits: &[Hit]) {
        let n = hits.len();
        assert!(shape.stride.is_multiple_of(LANES) && shape.n_positions <= shape.stride);
        assert_eq!(queries.len(), n * shape.n_channels);
        assert!(ranges.is_none_or(|r| r.len() == n && r.iter().all(|r| r[1] as usize <= shape.n_positions)));
        match *self {
            Codes::Full { data, row_len } => {
                assert!(row_len >= shape.n_channels * shape.stride && data.len() == n * row_len);
            }
            Codes::LowRank { left, row_len, right, rank } => {
                assert!(row_len >= shape.n_channels * rank && left.len() == n * row_len);
                assert_eq!(right.len(), shape.n_channels * rank * shape.stride);
            }
        }
    }
}
