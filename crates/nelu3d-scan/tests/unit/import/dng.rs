//! DNG files made of plain bytes.

/// A DNG file to be written.
#[derive(Clone)]
pub(crate) struct Dng {
    pub width: usize,
    pub height: usize,
    pub bits: usize,
    pub big_endian: bool,
    pub photometric: u32,
    pub cfa: Option<[u32; 4]>,
    pub white: Option<u32>,
    /// Numerators over 2.
    pub black: Vec<u32>,
    pub compression: u32,
    pub rows_per_strip: usize,
    /// Tiles instead of strips.
    pub tile: Option<(usize, usize)>,
    /// Whether the raw image hangs from a preview.
    pub child: bool,
    /// Top, left, bottom, right.
    pub active: Option<[u32; 4]>,
    pub table: Vec<u32>,
}

/// As Chronos cameras write them.
pub(crate) fn chronos(width: usize, height: usize) -> Dng {
    Dng {
        width,
        height,
        bits: 16,
        big_endian: false,
        photometric: 32803,
        cfa: Some([1, 0, 2, 1]),
        white: Some(4095),
        black: vec![],
        compression: 1,
        rows_per_strip: height,
        tile: None,
        child: false,
        active: None,
        table: vec![],
    }
}

/// A tag, its type and its values (numerators and denominators of rationals).
type Entry = (u32, u32, Vec<u32>);

impl Dng {
    /// The file with these codes.
    pub(crate) fn bytes(&self, codes: &[u16]) -> Vec<u8> {
        assert_eq!(codes.len(), self.width * self.height);
        let mut file = if self.big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
        file.extend([0; 4]);
        let (w, h) = self.tile.unwrap_or((self.width, self.rows_per_strip));
        let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
        for y0 in (0..self.height).step_by(h) {
            for x0 in (0..self.width).step_by(w) {
                offsets.push(file.len() as u32);
                // Tiles are padded, strips are not.
                let rows = if self.tile.is_some() { h } else { h.min(self.height - y0) };
                for y in y0..y0 + rows {
                    let code =
                        |x: usize| if x < self.width && y < self.height { codes[y * self.width + x] } else { 0xab };
                    self.push_row(&(x0..x0 + w).map(code).collect::<Vec<u16>>(), &mut file);
                }
                lengths.push(file.len() as u32 - offsets[offsets.len() - 1]);
            }
        }
        let mut raw: Vec<Entry> = vec![
            (254, 4, vec![0]),
            (256, 4, vec![self.width as u32]),
            (257, 4, vec![self.height as u32]),
            (258, 3, vec![self.bits as u32]),
            (259, 3, vec![self.compression]),
            (262, 3, vec![self.photometric]),
            (277, 3, vec![1]),
        ];
        if let Some((w, h)) = self.tile {
            raw.extend([(322, 3, vec![w as u32]), (323, 3, vec![h as u32]), (324, 4, offsets), (325, 4, lengths)]);
        } else {
            raw.extend([(273, 4, offsets), (278, 4, vec![self.rows_per_strip as u32]), (279, 4, lengths)]);
        }
        if let Some(cfa) = self.cfa {
            raw.extend([(33421, 3, vec![2, 2]), (33422, 1, cfa.to_vec())]);
        }
        raw.push((50706, 1, vec![1, 4, 0, 0]));
        if !self.table.is_empty() {
            raw.push((50712, 3, self.table.clone()));
        }
        if !self.black.is_empty() {
            raw.push((50714, 5, self.black.iter().flat_map(|&n| [n, 2]).collect()));
        }
        raw.extend(self.white.map(|w| (50717, 3, vec![w])));
        raw.extend(self.active.map(|a| (50829, 4, a.to_vec())));
        let mut first = self.push_directory(raw, &mut file);
        if self.child {
            // A gray pixel, as the preview.
            let preview = vec![
                (254, 4, vec![1]),
                (256, 4, vec![1]),
                (257, 4, vec![1]),
                (258, 3, vec![8]),
                (262, 3, vec![1]),
                (273, 4, vec![8]),
                (279, 4, vec![1]),
                (330, 4, vec![first]),
            ];
            first = self.push_directory(preview, &mut file);
        }
        file[4..8].copy_from_slice(&self.u32(first));
        file
    }

    fn push_row(&self, codes: &[u16], file: &mut Vec<u8>) {
        if self.bits == 16 {
            file.extend(codes.iter().flat_map(|&c| self.u16(c)));
            return;
        }
        let text: String = codes.iter().map(|c| format!("{c:0width$b}", width = self.bits)).collect();
        for byte in text.as_bytes().chunks(8) {
            let digits = String::from_utf8(byte.to_vec()).unwrap();
            file.push(u8::from_str_radix(&format!("{digits:0<8}"), 2).unwrap());
        }
    }

    /// Appends a directory and returns where it is.
    fn push_directory(&self, mut entries: Vec<Entry>, file: &mut Vec<u8>) -> u32 {
        entries.sort();
        let mut table = self.u16(entries.len() as u16).to_vec();
        for (tag, kind, values) in entries {
            let mut bytes: Vec<u8> = match kind {
                1 => values.iter().map(|&v| v as u8).collect(),
                3 => values.iter().flat_map(|&v| self.u16(v as u16)).collect(),
                _ => values.iter().flat_map(|&v| self.u32(v)).collect(),
            };
            table.extend(self.u16(tag as u16));
            table.extend(self.u16(kind as u16));
            table.extend(self.u32(if kind == 5 { values.len() as u32 / 2 } else { values.len() as u32 }));
            if bytes.len() <= 4 {
                bytes.resize(4, 0);
                table.extend(bytes);
            } else {
                file.resize(file.len().next_multiple_of(2), 0);
                table.extend(self.u32(file.len() as u32));
                file.extend(bytes);
            }
        }
        file.resize(file.len().next_multiple_of(2), 0);
        let at = file.len() as u32;
        file.extend(table);
        file.extend([0; 4]);
        at
    }

    fn u16(&self, v: u16) -> [u8; 2] {
        if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() }
    }

    fn u32(&self, v: u32) -> [u8; 4] {
        if self.big_endian { v.to_be_bytes() } else { v.to_le_bytes() }
    }
}
