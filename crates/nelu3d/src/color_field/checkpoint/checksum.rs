//! The checksum of a checkpoint: what a disk or a cable changed is noticed, wherever it is.
//!
//! It is the SHA-256 of the description, as it is written without the checksum, and of all tensors in the order of
//! their names. It stands at the description's end, so that the text before it can be hashed as it is.

use sha2::{Digest, Sha256};

/// How the checksum begins at the end of a description.
const KEY: &str = ",\"sha256\":\"";
/// How it ends, and the description with it.
const END: &str = "\"}";

/// Returns the checksum of a description and its tensors (name and bytes), hexadecimal.
pub fn checksum<'a>(json: &str, tensors: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> String {
    let mut tensors: Vec<(&str, &[u8])> = tensors.into_iter().collect();
    tensors.sort_unstable_by_key(|t| t.0);
    let mut hash = Sha256::new();
    hash.update(json);
    for (name, bytes) in tensors {
        hash.update(name);
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    }
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Returns a description, a JSON object with at least one key, with its checksum.
pub fn with_checksum(json: &str, checksum: &str) -> String {
    format!("{}{KEY}{checksum}{END}", json.strip_suffix('}').expect("an object"))
}

/// Splits a description into what it was without the checksum, and the checksum; `None` if it does not end in one.
pub fn without_checksum(json: &str) -> Option<(String, &str)> {
    let (before, checksum) = json.strip_suffix(END)?.rsplit_once(KEY)?;
    Some((format!("{before}}}"), checksum))
}
