//! Reading the files of other programs: regular files only, and none larger than its reader can use.
//!
//! A pipe never ends, a device has no end at all, and a name in a description may lead to either. Every file that the
//! workspace reads goes through here, so that each is refused in the same words.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

/// Largest text file that is read (descriptions, poses, results), bytes.
pub const MAX_TEXT: u64 = 64 << 20;
/// Largest file of numbers that is read as a whole (images, meshes, arrays, color fields), bytes.
pub const MAX_DATA: u64 = 4 << 30;

/// Opens a regular file; also returns its size in bytes. Links are followed.
///
/// # Errors
///
/// There is no such file, it may not be read, or it is a folder, a pipe, a socket, or a device. The message says what
/// is wrong and what to do, but does not name the file: the caller's does.
pub fn open_file(path: &Path) -> io::Result<(File, u64)> {
    open(path).map_err(|e| explain(&e))
}

/// Reads a regular file of at most `max_bytes`.
///
/// # Errors
///
/// As [`open_file`], or the file is larger.
pub fn read_file(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let read = || {
        let (file, size) = open(path)?;
        if size > max_bytes {
            return Err(too_large(max_bytes));
        }
        let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
        // It may grow meanwhile, and files of the system state no size.
        file.take(max_bytes + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > max_bytes { Err(too_large(max_bytes)) } else { Ok(bytes) }
    };
    read().map_err(|e| explain(&e))
}

/// Reads a text file of at most [`MAX_TEXT`] bytes.
///
/// # Errors
///
/// As [`read_file`], or it is no UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let bytes = read_file(path, MAX_TEXT)?;
    String::from_utf8(bytes).map_err(|e| {
        let problem = format!("it is no text ({}); give a text file in UTF-8", e.utf8_error());
        io::Error::new(io::ErrorKind::InvalidData, problem)
    })
}

/// Returns what a decoder says as part of a sentence: in one line, and no longer than people read, for decoders quote
/// what they find in damaged files.
pub fn shortened(reason: &str) -> String {
    const LONGEST: usize = 200;
    // What Rust's readers say of a file that ends.
    let reason = reason.replace("failed to fill whole buffer", "it ends too early");
    let line = reason.split(char::is_control).map(str::trim).filter(|part| !part.is_empty());
    let line = line.collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} …", line[..end].trim_end()),
        None => line,
    }
}

/// Returns the TOML parser's message about `text` in one line: its own draws the place over several.
pub fn toml_reason(e: &toml::de::Error, text: &str) -> String {
    let message = shortened(e.message());
    match e.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {message}", before.matches('\n').count() + 1),
        None => message,
    }
}

fn open(path: &Path) -> io::Result<(File, u64)> {
    // Asked before opening, which alone may wind a tape or wait for a pipe's other end.
    only_regular(&path.metadata()?)?;
    let mut options = OpenOptions::new();
    options.read(true);
    // A pipe that has taken the file's place since then is not waited for.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(
        &mut options,
        i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap_or(0),
    );
    let file = options.open(path)?;
    let metadata = file.metadata()?;
    only_regular(&metadata)?;
    Ok((file, metadata.len()))
}

fn only_regular(metadata: &std::fs::Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    Err(if metadata.is_dir() {
        io::ErrorKind::IsADirectory.into()
    } else {
        let problem = "it is a pipe, a socket or a device; give a regular file";
        io::Error::new(io::ErrorKind::InvalidInput, problem)
    })
}

fn too_large(max_bytes: u64) -> io::Error {
    let problem = if max_bytes >= 1 << 30 {
        format!("{:.1} GB", max_bytes as f64 / 1e9)
    } else {
        format!("{:.1} MB", max_bytes as f64 / 1e6)
    };
    let problem = format!("it is larger than the {problem} that such a file can have; give the right file");
    io::Error::new(io::ErrorKind::FileTooLarge, problem)
}

/// Returns an error of reading a file or folder with a remedy in its message.
pub(crate) fn explain(e: &io::Error) -> io::Error {
    let text = match e.kind() {
        io::ErrorKind::NotFound => "there is no such file; correct its name, or put it there".into(),
        io::ErrorKind::IsADirectory => "it is a folder; give a file".into(),
        io::ErrorKind::NotADirectory => "a part of this path is a file, not a folder; correct the path".into(),
        io::ErrorKind::PermissionDenied => format!("{e}; change its permissions"),
        // They say what to do.
        io::ErrorKind::InvalidInput | io::ErrorKind::FileTooLarge => e.to_string(),
        _ => format!("{e}; check the name and the disk"),
    };
    io::Error::new(e.kind(), text)
}
