//! What LookUp3D puts on record.

use serde::Serialize;

use super::table::Table;

/// What LookUp3D puts on record of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LookupDiagnostics {
    /// The table that was searched.
    pub table: TableSummary,
    /// Pixels of the table whose window explained nothing, so that all positions were searched.
    pub fallbacks: usize,
}

/// The sizes of a lookup table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct TableSummary {
    /// Pixels of a row of the table.
    pub width: usize,
    /// Rows of the table.
    pub height: usize,
    /// Camera pixels between two pixels of the table.
    pub stride: usize,
    /// Board positions.
    pub positions: usize,
    /// Channels of a codeword.
    pub channels: usize,
    /// Terms per channel of a low-rank table; `None` for a full one.
    pub rank: Option<usize>,
    /// Memory of the table's entries, bytes.
    pub bytes: usize,
}

impl TableSummary {
    /// Summarizes a table.
    pub(crate) fn of(table: &Table) -> Self {
        let shape = table.shape();
        let rank = match table {
            Table::Full(_) => None,
            Table::LowRank(t) => Some(t.rank),
        };
        Self {
            width: shape.width,
            height: shape.height,
            stride: shape.step,
            positions: shape.n_positions,
            channels: shape.k,
            rank,
            bytes: table.bytes(),
        }
    }
}
