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
pub(super) fn checksum<'a>(json: &str, tensors: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> String {
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
pub(super) fn with_checksum(json: &str, checksum: &str) -> String {
    format!("{}{KEY}{checksum}{END}", json.strip_suffix('}').expect("an object"))
}

/// Splits a description into what it was without the checksum, and the checksum; `None` if it does not end in one.
pub(super) fn without_checksum(json: &str) -> Option<(String, &str)> {
    let (before, checksum) = json.strip_suffix(END)?.rsplit_once(KEY)?;
    Some((format!("{before}}}"), checksum))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_goes_on_and_off() {
        let json = "{\"a\":1}";
        let sum = checksum(json, [("x", &[1u8, 2][..]), ("b", &[3][..])]);
        assert_eq!(sum, checksum(json, [("b", &[3u8][..]), ("x", &[1, 2][..])]), "the order does not matter");
        assert_ne!(sum, checksum(json, [("b", &[3u8, 1][..]), ("x", &[2][..])]), "what is where does");
        let whole = with_checksum(json, &sum);
        assert!(serde_json::from_str::<serde_json::Value>(&whole).is_ok());
        assert_eq!(without_checksum(&whole), Some((json.to_owned(), &sum[..])));
        assert_eq!(without_checksum(json), None);
    }
}
