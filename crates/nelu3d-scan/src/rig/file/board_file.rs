//! The table `[board]` alone: read from any file that has one, and written for people to copy.

use std::path::Path;

use super::board::board;
use super::problems::Problems;
use super::schema::{BoardToml, board_to_toml};
use crate::board::Board;
use crate::input::{read_text, toml_reason};
use crate::rig::{RIG_FILE, RigError};

#[derive(serde::Serialize)]
struct BoardFile {
    board: BoardToml,
}

/// Returns the lines of rig.toml that describe a board: its table `[board]`.
///
/// # Errors
///
/// The board holds a value that could not be read back.
pub fn board_lines(described: &Board) -> Result<String, RigError> {
    let path = Path::new(RIG_FILE);
    let mut problems = Problems { path: path.to_path_buf(), found: Vec::new() };
    board(board_to_toml(described), &mut problems);
    if let Some(first) = problems.found.into_iter().next() {
        return Err(first);
    }
    let syntax = |reason: String| RigError::Syntax { path: path.to_path_buf(), reason };
    toml::to_string(&BoardFile { board: board_to_toml(described) }).map_err(|e| syntax(e.to_string()))
}

/// Reads the board of a TOML file with a table `[board]`: a rig.toml, or the lines that `nelu3d board` prints. `path`
/// may be the folder of a rig.
///
/// # Errors
///
/// The file cannot be read or parsed, has no `[board]`, or one that makes no sense; the message names the key.
pub fn read_board(path: &Path) -> Result<Board, RigError> {
    let file = if path.is_dir() { path.join(RIG_FILE) } else { path.to_path_buf() };
    let text = read_text(&file).map_err(|source| RigError::Io { path: file.clone(), source })?;
    let syntax = |reason| RigError::Syntax { path: file.clone(), reason };
    let mut table: toml::Table = toml::from_str(&text).map_err(|e| syntax(toml_reason(&e, &text)))?;
    let mut problems = Problems { path: file.clone(), found: Vec::new() };
    let remedy = "describe the board as rig.toml does; `nelu3d board` prints the lines";
    let Some(value) = table.remove("board") else {
        problems.expect(false, "board", "is missing", remedy);
        return Err(problems.found.swap_remove(0));
    };
    let toml: BoardToml = value.try_into().map_err(|e: toml::de::Error| syntax(toml_reason(&e, "")))?;
    let found = board(toml, &mut problems);
    match (found, problems.found.into_iter().next()) {
        (Some(board), None) => Ok(board),
        (_, Some(first)) => Err(first),
        (None, None) => Err(syntax("[board] is no board".into())),
    }
}
