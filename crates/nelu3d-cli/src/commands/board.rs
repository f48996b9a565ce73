//! `nelu3d board`: a board on paper, and the lines of rig.toml that describe it.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use nelu3d_scan::board::print::{BoardPrint, PrintOptions};
use nelu3d_scan::board::{Artwork, Board, BoardKind, Dictionary};
use nelu3d_scan::output::write_atomic;
use nelu3d_scan::rig::{board_lines, read_board};

use crate::args::{BoardArgs, BoardCommand, PrintArgs};
use crate::context::CommandContext;
use crate::paths::shown;

/// Length of the rulers, mm.
const RULER_MM: f64 = 100.0;

/// Runs the command.
pub(crate) fn run(args: BoardArgs, context: &CommandContext) -> Result<()> {
    let (board, output) = described(args.command)?;
    let scale = output.measured.map_or(board.scale, |measured| measured.map(|mm| mm / RULER_MM));
    if let Some(wrong) = scale.iter().find(|s| !(0.9..=1.1).contains(*s)) {
        let measured = wrong * RULER_MM;
        bail!(
            "--measured: a ruler of 100 mm does not become one of {measured} mm; give what each ruler measures, in mm"
        );
    }
    // The outline grows with the print.
    let extent_mm = std::array::from_fn(|i| board.extent_mm[i] / board.scale[i % 2] * scale[i % 2]);
    let board = Board { extent_mm, scale, ..board };
    // First what is wrong with the board: the lines' own complaint would name a rig.toml that nobody has.
    Artwork::new(&board)?;
    let lines = board_lines(&board)?;

    // Who has measured a print does not need another.
    let wanted = output.output.is_some() || output.measured.is_none();
    let files = if wanted { write(&board, &output)? } else { Vec::new() };
    let names: Vec<String> = files.iter().map(|file| shown(file)).collect();
    context.answer(&serde_json::json!({ "files": names, "board": lines }), || {
        let written = match files.as_slice() {
            [] => String::new(),
            [one] => format!("# written   {}\n", shown(one)),
            [first, .., last] => format!("# written   {} files, {} to {}\n", files.len(), shown(first), shown(last)),
        };
        let hint = match output.measured {
            None => "# print it at 100 %, measure both rulers, and give --measured XxY for the lines of rig.toml:\n",
            Some(_) => "",
        };
        format!("{written}{hint}{lines}")
    })?;
    Ok(())
}

/// Returns the board that was asked for, and where to.
fn described(command: BoardCommand) -> Result<(Board, PrintArgs)> {
    let (kind, output) = match command {
        BoardCommand::Charuco(a) => {
            let [columns, rows] = a.squares.number;
            let marker_mm = a.marker.unwrap_or(0.75 * a.squares.side_mm);
            let dictionary = Dictionary::by_name(&a.dictionary)?.name().to_owned();
            let (square_mm, legacy) = (a.squares.side_mm, a.legacy);
            (BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy }, a.output)
        }
        BoardCommand::Chessboard(a) => {
            let [columns, rows] = a.squares.number;
            (BoardKind::Chessboard { columns, rows, square_mm: a.squares.side_mm }, a.output)
        }
        BoardCommand::Markers(a) => {
            let dictionary = Dictionary::by_name(&a.dictionary)?.name();
            let gap = a.gap.unwrap_or(0.25 * a.marker);
            (BoardKind::marker_frame(a.size, a.marker, gap, dictionary, a.first)?, a.output)
        }
        BoardCommand::Rig(a) => return Ok((read_board(&a.rig)?, a.output)),
    };
    let extent_mm = kind.bounding_box_mm();
    Ok((Board { kind, extent_mm, scale: [1.0, 1.0] }, output))
}

/// Writes the files of a board; returns their names.
fn write(board: &Board, args: &PrintArgs) -> Result<Vec<PathBuf>> {
    let options = PrintOptions { paper: args.paper, margin_mm: args.margin, overlap_mm: args.overlap };
    let print = BoardPrint::new(board, &options)?;
    let output = args.output.clone().unwrap_or_else(|| "board.pdf".into());
    let ending = output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    let files: Vec<PathBuf> = match ending.as_str() {
        "pdf" => vec![output],
        "svg" | "png" if print.sheets.len() == 1 => vec![output],
        "svg" | "png" => print.sheets.iter().map(|s| numbered(&output, s.place)).collect(),
        _ => bail!("{}: its ending tells no format; name it .pdf, .svg or .png", shown(&output)),
    };
    if let Some(there) = files.iter().find(|f| f.exists() && !args.force) {
        bail!("{}: exists; give --force to replace it, or another file with -o FILE", shown(there));
    }
    for (i, file) in files.iter().enumerate() {
        let bytes = match ending.as_str() {
            "pdf" => print.to_pdf(),
            "svg" => print.sheets[i].to_svg().into_bytes(),
            _ => print.sheets[i].to_png(args.dpi).with_context(|| shown(file))?,
        };
        write_atomic(file, |w| w.write_all(&bytes))?;
    }
    Ok(files)
}

/// Returns the name of one of several sheets: `board-2-1.svg` is of the second row and the first column.
fn numbered(path: &Path, [row, column]: [usize; 2]) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{}-{}.{ending}", row + 1, column + 1))
}
