//! Codes from the bytes of strips and tiles.

/// A strip or tile.
pub(super) struct Chunk {
    /// Where its bytes begin in the file.
    pub offset: usize,
    /// How many there are.
    pub len: usize,
    /// Its left column in the image.
    pub x: usize,
    /// Its top row in the image.
    pub y: usize,
    /// Pixels of a row; those beyond the image are padding.
    pub width: usize,
    /// Rows that lie in the image.
    pub rows: usize,
}

/// Writes a chunk's codes of `bits` = 8 to 16 into an image of `width` columns. Codes of 16 bits are in the file's byte
/// order; others are packed from the high bit down whatever the byte order is, and rows begin with a byte (TIFF 6.0,
/// p. 39; DNG 1.6, BitsPerSample).
pub(super) fn unpack(
    file: &[u8],
    chunk: &Chunk,
    bits: usize,
    big_endian: bool,
    width: usize,
    codes: &mut [u16],
) -> Result<(), String> {
    let row_bytes = (chunk.width.saturating_mul(bits)).div_ceil(8);
    let needed = row_bytes.saturating_mul(chunk.rows);
    let end = chunk.offset.saturating_add(needed);
    if chunk.len < needed || end > file.len() {
        let there = chunk.len.min(file.len().saturating_sub(chunk.offset));
        return Err(format!("of {needed} bytes of pixels {there} are there"));
    }
    let visible = chunk.width.min(width - chunk.x);
    for (row, bytes) in file[chunk.offset..end].chunks_exact(row_bytes).enumerate() {
        let start = (chunk.y + row) * width + chunk.x;
        let out = &mut codes[start..start + visible];
        if bits == 16 {
            for (code, pair) in out.iter_mut().zip(bytes.as_chunks().0) {
                *code = if big_endian { u16::from_be_bytes(*pair) } else { u16::from_le_bytes(*pair) };
            }
        } else {
            for (x, code) in out.iter_mut().enumerate() {
                *code = packed(bytes, x * bits, bits);
            }
        }
    }
    Ok(())
}

/// Returns the `bits` ≤ 16 bits from bit `at` on. Up to 23 bits have to be looked at: three bytes.
fn packed(bytes: &[u8], at: usize, bits: usize) -> u16 {
    let byte = |i: usize| u32::from(bytes.get(at / 8 + i).copied().unwrap_or(0));
    let window = byte(0) << 16 | byte(1) << 8 | byte(2);
    let mask = (1 << bits) - 1;
    (window >> (24 - at % 8 - bits) & mask) as u16
}
