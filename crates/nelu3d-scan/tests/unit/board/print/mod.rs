mod outline;

use nelu3d_scan::board::print::{BoardPrint, Paper, PrintOptions};
use nelu3d_scan::board::{Artwork, Board, BoardKind, Detector};

/// Boards of every kind, the second of which goes over several sheets of A5.
fn boards() -> Vec<(&'static str, Board, PrintOptions)> {
    let charuco = |columns, rows, square_mm, legacy| BoardKind::Charuco {
        columns,
        rows,
        square_mm,
        marker_mm: 0.7 * square_mm,
        dictionary: "DICT_4X4_250".into(),
        legacy,
    };
    let frame = |dictionary| BoardKind::marker_frame([150.0, 120.0], 22.0, 6.0, dictionary, 3).unwrap();
    let a4 = PrintOptions::default();
    let a5 = PrintOptions { paper: Paper::from_name("a5").unwrap(), margin_mm: 6.0, overlap_mm: 8.0 };
    let board = |kind: BoardKind| Board { extent_mm: kind.bounding_box_mm(), kind, scale: [1.0, 1.0] };
    vec![
        ("charuco", board(charuco(7, 5, 24.0, false)), a4),
        ("charuco over sheets", board(charuco(8, 7, 25.0, false)), a5),
        ("legacy charuco", board(charuco(7, 6, 24.0, true)), a4),
        ("chessboard", board(BoardKind::Chessboard { columns: 7, rows: 8, square_mm: 22.0 }), a4),
        ("markers", board(frame("DICT_5X5_100")), a4),
        ("AprilTags", board(frame("DICT_APRILTAG_36h11")), a4),
    ]
}

/// The sheets of a print, laid together: a gray image in [0, 1], and the board's origin on it, px.
fn joined(print: &BoardPrint, dots_per_inch: f64) -> (Vec<f32>, usize, usize, [f64; 2]) {
    let per_mm = dots_per_inch / 25.4;
    let from = print.sheets[0].board_from_sheet_mm;
    let end = print.sheets.last().unwrap();
    let size: [f64; 2] =
        std::array::from_fn(|k| ((end.board_from_sheet_mm[k] - from[k] + end.size_mm[k]) * per_mm).ceil() + 1.0);
    let [width, height] = size.map(|s| s as usize);
    let mut whole = vec![0.98f32; width * height];
    for sheet in &print.sheets {
        let raw = nelu3d_scan::image::decode_bytes("sheet.png".as_ref(), &sheet.to_png(dots_per_inch).unwrap(), None)
            .unwrap();
        let image = raw.linearize("sheet.png".as_ref(), nelu3d_scan::image::Channels::Mono, 0.0, 255.0).unwrap();
        let at = [0, 1].map(|k| ((sheet.board_from_sheet_mm[k] - from[k]) * per_mm).round() as usize);
        for y in 0..image.height {
            for x in 0..image.width {
                let pixel = &mut whole[(y + at[1]) * width + x + at[0]];
                // Short of full scale, at which the detector takes it for clipped.
                *pixel = pixel.min(0.98 * image.data[y * image.width + x]);
            }
        }
    }
    // Pixel centers at integers: the sheet's edge lies half a pixel before the first.
    (whole, width, height, from.map(|f| -f * per_mm - 0.5))
}

/// What is printed is what the detector looks for, where it looks for it: the corners of every kind lie on the page to
/// 0.05 mm, all of them.
#[test]
fn prints_are_found_where_they_were_printed() {
    let dots_per_inch = 127.0;
    for (name, board, options) in boards() {
        let print = BoardPrint::new(&board, &options).unwrap();
        assert_eq!(print.sheets.len() > 1, name.contains("sheets"), "{name}: {:?}", print.grid);
        let (image, width, height, origin) = joined(&print, dots_per_inch);
        let corners = Detector::new(&board).unwrap().detect(&image, width, height).unwrap();
        let all = match &board.kind {
            BoardKind::Charuco { columns, rows, .. } | BoardKind::Chessboard { columns, rows, .. } => {
                (columns - 1) * (rows - 1)
            }
            BoardKind::Markers { markers, .. } => 4 * markers.len(),
        };
        assert_eq!(corners.len(), all, "{name}");
        let worst = corners
            .iter()
            .flat_map(|c| [0, 1].map(|k| (c.px[k] - origin[k]) * 25.4 / dots_per_inch - c.board_mm[k]))
            .fold(0.0, |a: f64, b| a.max(b.abs()));
        eprintln!("{name}: {} corners, worst {worst:.4} mm", corners.len());
        // Sheets are laid together to whole pixels, half of one off at most.
        let joint = if print.sheets.len() > 1 { 0.5 * 25.4 / dots_per_inch } else { 0.0 };
        assert!(worst < 0.05 + joint, "{name}: {worst} mm");
    }
}

/// Shapes are black where the artwork is, which the simulator draws from the same layout by other means.
#[test]
fn shapes_are_the_artwork() {
    let dots_per_inch = 101.6;
    let per_mm = dots_per_inch / 25.4;
    for (name, board, options) in boards() {
        let artwork = Artwork::new(&board).unwrap();
        let [x0, y0, x1, y1] = board.extent_mm;
        for sheet in &BoardPrint::new(&board, &options).unwrap().sheets {
            let raw = nelu3d_scan::image::decode_bytes("s.png".as_ref(), &sheet.to_png(dots_per_inch).unwrap(), None)
                .unwrap();
            let image = raw.linearize("s.png".as_ref(), nelu3d_scan::image::Channels::Mono, 0.0, 255.0).unwrap();
            let edge = ((options.margin_mm + 0.3) * per_mm) as usize;
            let (mut wrong, mut n) = (0, 0);
            for y in edge..image.height - edge {
                for x in edge..image.width - edge {
                    let at = [x, y].map(|v| (v as f64 + 0.5) / per_mm);
                    let [bx, by] = [0, 1].map(|k| at[k] + sheet.board_from_sheet_mm[k]);
                    if (x0..x1).contains(&bx) && (y0..y1).contains(&by) {
                        let gray = image.data[y * image.width + x];
                        // Pixels that an edge crosses are neither.
                        if !(0.02..=0.98).contains(&gray) {
                            n += 1;
                            wrong += usize::from((artwork.albedo(bx, by) > 0.5) != (gray > 0.5));
                        }
                    }
                }
            }
            assert!(wrong == 0 && n > 1000, "{name}: {wrong} of {n}");
        }
    }
}

#[test]
fn a_measured_print_stretches_the_corners_that_are_found() {
    let (_, board, options) = boards().swap_remove(0);
    let (image, width, height, _) = joined(&BoardPrint::new(&board, &options).unwrap(), 127.0);
    let nominal = Detector::new(&board).unwrap().detect(&image, width, height).unwrap();
    let scaled = Board { scale: [0.996, 1.004], ..board };
    let stretched = Detector::new(&scaled).unwrap().detect(&image, width, height).unwrap();
    for (a, b) in nominal.iter().zip(&stretched) {
        assert_eq!(a.px, b.px);
        assert_eq!([a.board_mm[0] * 0.996, a.board_mm[1] * 1.004], b.board_mm);
    }
    let (a, b) = (Artwork::new(&boards()[0].1).unwrap(), Artwork::new(&scaled).unwrap());
    for i in 0..500 {
        let (x, y) = (0.31 * i as f64, 0.23 * i as f64);
        assert_eq!(a.albedo(x, y), b.albedo(0.996 * x, 1.004 * y), "{x} {y}");
    }
    let impossible = Board { scale: [1.0, 0.0], ..scaled };
    assert!(Detector::new(&impossible).unwrap_err().to_string().contains("1 by 0 times"));
}

#[test]
fn paper_has_names_and_limits() {
    assert_eq!(Paper::from_name("A3").unwrap().size_mm, [297.0, 420.0]);
    assert_eq!(Paper::from_name("100.5x70").unwrap().size_mm, [100.5, 70.0]);
    assert!(["b4", "100", "0x5", "nanx3", "1e9x5", ""].iter().all(|name| Paper::from_name(name).is_none()));
    let (_, board, options) = boards().swap_remove(0);
    let small = PrintOptions { paper: Paper::from_name("80x80").unwrap(), ..options };
    let error = BoardPrint::new(&board, &small).unwrap_err().to_string();
    assert!(error.contains("80 x 80 mm") && error.contains("take larger paper"), "{error}");
    assert!(BoardPrint::new(&board, &PrintOptions { margin_mm: f64::NAN, ..options }).is_err());
    assert!(BoardKind::marker_frame([50.0, 50.0], 24.0, 5.0, "DICT_4X4_50", 0).is_err());
    // A picture too large to make is an error, not a crash.
    assert!(BoardPrint::new(&board, &options).unwrap().sheets[0].to_png(1e6).is_err());
}
