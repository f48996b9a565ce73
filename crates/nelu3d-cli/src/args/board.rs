//! Arguments of `board`: what is printed, and on what.

use std::path::PathBuf;

use clap::Subcommand;
use nelu3d_scan::board::print::{Paper, PrintOptions};

/// Arguments of `nelu3d board`.
#[derive(Debug, clap::Args)]
pub(crate) struct BoardArgs {
    /// What is printed.
    #[command(subcommand)]
    pub command: BoardCommand,
}

/// The kinds of board.
#[derive(Debug, Subcommand)]
pub(crate) enum BoardCommand {
    /// A chessboard with ArUco markers in its white squares: may be seen in part.
    Charuco(CharucoArgs),
    /// A plain chessboard: must be seen whole.
    Chessboard(ChessboardArgs),
    /// ArUco markers around an empty middle: the light falls on bare paper.
    Markers(MarkersArgs),
    /// The board that a rig.toml describes.
    Rig(RigBoardArgs),
}

/// The squares of a board.
#[derive(Debug, clap::Args)]
pub(crate) struct SquareArgs {
    /// Squares along x and along y.
    #[arg(long = "squares", value_name = "NxM", default_value = "8x11", value_parser = count)]
    pub number: [usize; 2],
    /// Side of a square, mm.
    #[arg(long = "square", value_name = "MM", default_value_t = 20.0, value_parser = length)]
    pub side_mm: f64,
}

/// Arguments of `nelu3d board charuco`.
#[derive(Debug, clap::Args)]
pub(crate) struct CharucoArgs {
    /// The squares.
    #[command(flatten)]
    pub squares: SquareArgs,
    /// Side of a marker, mm (default: three quarters of a square).
    #[arg(long, value_name = "MM", value_parser = length)]
    pub marker: Option<f64>,
    /// OpenCV's name of a dictionary.
    #[arg(long, value_name = "NAME", default_value = "DICT_4X4_250")]
    pub dictionary: String,
    /// The layout of OpenCV before 4.6 (setLegacyPattern).
    #[arg(long)]
    pub legacy: bool,
    /// Where to.
    #[command(flatten)]
    pub output: PrintArgs,
}

/// Arguments of `nelu3d board chessboard`.
#[derive(Debug, clap::Args)]
pub(crate) struct ChessboardArgs {
    /// The squares.
    #[command(flatten)]
    pub squares: SquareArgs,
    /// Where to.
    #[command(flatten)]
    pub output: PrintArgs,
}

/// Arguments of `nelu3d board markers`.
#[derive(Debug, clap::Args)]
pub(crate) struct MarkersArgs {
    /// Width and height of the frame, mm.
    #[arg(long, value_name = "WxH", default_value = "170x240", value_parser = lengths)]
    pub size: [f64; 2],
    /// Side of a marker, mm.
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = length)]
    pub marker: f64,
    /// Smallest gap between markers, mm (default: a quarter of a marker).
    #[arg(long, value_name = "MM", value_parser = length)]
    pub gap: Option<f64>,
    /// OpenCV's name of a dictionary.
    #[arg(long, value_name = "NAME", default_value = "DICT_4X4_250")]
    pub dictionary: String,
    /// Number of the first marker in the dictionary.
    #[arg(long, value_name = "ID", default_value_t = 0)]
    pub first: u32,
    /// Where to.
    #[command(flatten)]
    pub output: PrintArgs,
}

/// Arguments of `nelu3d board rig`.
#[derive(Debug, clap::Args)]
pub(crate) struct RigBoardArgs {
    /// Rig folder, its rig.toml, or any file with a table [board].
    pub rig: PathBuf,
    /// Where to.
    #[command(flatten)]
    pub output: PrintArgs,
}

/// Paper, file, and what was measured on it.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Print")]
pub(crate) struct PrintArgs {
    /// Paper: a0 to a5, letter, legal, tabloid, or a size in mm as 210x297. Larger boards go on several sheets, with
    /// marks to join them by.
    #[arg(long, value_name = "SIZE", default_value = "a4", value_parser = paper)]
    pub paper: Paper,
    /// What the printer leaves white along the edges of a sheet, mm.
    #[arg(long, value_name = "MM", default_value_t = PrintOptions::default().margin_mm, value_parser = margin)]
    pub margin: f64,
    /// Width of the strips that neighboring sheets both show, mm.
    #[arg(long, value_name = "MM", default_value_t = PrintOptions::default().overlap_mm, value_parser = margin)]
    pub overlap: f64,
    /// What the rulers of 100 mm along x and y measure on the print, mm: rig.toml's lines then say so. Nothing is
    /// printed anew unless -o is given.
    #[arg(long, value_name = "XxY", value_parser = lengths)]
    pub measured: Option<[f64; 2]>,
    /// File to write, as its ending says: .pdf, .svg or .png (default: board.pdf). Of several sheets, .svg and .png
    /// become a file each, with row and column in their names.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Pixels an inch of .png.
    #[arg(long, value_name = "N", default_value_t = 600.0, value_parser = dots)]
    pub dpi: f64,
    /// Replace files that exist.
    #[arg(long)]
    pub force: bool,
}

/// Splits what stands before and after an x.
fn pair<T: std::str::FromStr>(text: &str) -> Option<[T; 2]> {
    let (a, b) = text.split_once(['x', 'X', '×'])?;
    Some([a.trim().parse().ok()?, b.trim().parse().ok()?])
}

/// Parses numbers of squares.
fn count(text: &str) -> Result<[usize; 2], String> {
    pair(text).ok_or_else(|| "squares along x and y, as 8x11".into())
}

/// Parses a length in mm.
fn length(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mm) if (0.1..=20_000.0).contains(&mm) => Ok(mm),
        _ => Err("a length in mm, from 0.1 to 20000".into()),
    }
}

/// Parses two lengths in mm.
fn lengths(text: &str) -> Result<[f64; 2], String> {
    let both: Option<[f64; 2]> = pair(text);
    both.filter(|b| b.iter().all(|mm| (0.1..=20_000.0).contains(mm)))
        .ok_or_else(|| "two lengths in mm along x and y, as 99.6x99.8".into())
}

/// Parses the width of a margin.
fn margin(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(mm) if (0.0..=100.0).contains(&mm) => Ok(mm),
        _ => Err("a width in mm, from 0 to 100".into()),
    }
}

/// Parses pixels an inch.
fn dots(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(dots) if (10.0..=4800.0).contains(&dots) => Ok(dots),
        _ => Err("a number from 10 to 4800".into()),
    }
}

/// Parses a size of paper.
fn paper(text: &str) -> Result<Paper, String> {
    let names = || Paper::names().collect::<Vec<_>>().join(", ");
    Paper::from_name(text).ok_or_else(|| format!("one of {}, or width and height in mm, as 210x297", names()))
}
