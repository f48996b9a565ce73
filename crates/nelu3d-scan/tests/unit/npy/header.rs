use nelu3d_scan::npy::{Header, NumberKind};

fn header(text: &str) -> Option<Header> {
    let length = (text.len() as u16).to_le_bytes();
    Header::read(&mut &[b"\x93NUMPY\x01\0", &length[..], text.as_bytes()].concat()[..]).ok()
}

#[test]
fn headers_round_trip() {
    for shape in [&[][..], &[6], &[240, 320], &[1, 2, 3, 4]] {
        let header = Header::new("<f4", shape);
        let mut bytes = Vec::new();
        header.write(&mut bytes).unwrap();
        assert_eq!((bytes.len() % 64, bytes[bytes.len() - 1]), (0, b'\n'));
        assert_eq!(Header::read(&mut &bytes[..]).unwrap(), header);
        for n in 0..bytes.len() {
            assert!(Header::read(&mut &bytes[..n]).is_err());
        }
    }
}

#[test]
fn what_other_programs_write_is_understood() {
    let numpy = header("{'descr': '>f8', 'fortran_order': True, 'shape': (2, 3), }          \n").unwrap();
    assert_eq!((numpy.fortran_order, &numpy.shape[..], numpy.len()), (true, &[2, 3][..], Some(6)));
    assert_eq!(numpy.number().unwrap().size, 8);
    let tight = header("{\"shape\":(7,),\"fortran_order\":False,\"descr\":\"|u1\"}").unwrap();
    assert_eq!((tight.number().unwrap().kind, &tight.shape[..]), (NumberKind::Uint, &[7][..]));
    let structured = header("{'descr': [('a', '<f4'), ('b', '<i2')], 'fortran_order': False, 'shape': ()}").unwrap();
    assert_eq!((structured.number(), structured.dtype.as_str()), (None, "[('a', '<f4'), ('b', '<i2')]"));
    for bad in [
        "",
        "{",
        "{'descr': '<f4'}",
        "{'descr': '<f4', 'fortran_order': 0, 'shape': (2,)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-2,)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': 2}",
        "{descr: '<f4', 'fortran_order': False, 'shape': (2,)}",
    ] {
        assert!(header(bad).is_none(), "{bad}");
    }
}

#[test]
fn numbers_of_all_kinds_are_read() {
    let number = |dtype: &str| Header::new(dtype, &[1]).number().unwrap();
    assert_eq!(number("<i2").read_i64(&mut &[0xfe, 0xff][..]).unwrap(), -2);
    assert_eq!(number(">i4").read_i64(&mut &[0, 0, 1, 0][..]).unwrap(), 256);
    assert_eq!(number("|u1").read_i64(&mut &[200][..]).unwrap(), 200);
    assert_eq!(number("<u8").read_i64(&mut &[0xff; 8][..]).unwrap(), -1);
    assert_eq!(number(">f8").read_f32(&mut &1.5f64.to_be_bytes()[..]).unwrap(), 1.5);
    assert!(number("<f4").read_f32(&mut &[0, 0, 0][..]).is_err());
    for bad in ["<f2", "<c8", "|b1", "|O", "<U3", ""] {
        assert_eq!(Header::new(bad, &[1]).number(), None, "{bad}");
    }
}
