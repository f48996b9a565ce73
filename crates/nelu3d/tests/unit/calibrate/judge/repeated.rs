use nelu3d::calibrate::judge::repeated::{Fingerprint, judge};
use nelu3d::verdict::Code;
use nelu3d_scan::Image;

#[test]
fn images_that_are_the_same_are_named() {
    let image = |shade: f32| Image {
        width: 500,
        height: 400,
        channels: 1,
        data: (0..200_000).map(|i| shade + (i % 7) as f32).collect(),
    };
    let of = |shades: [f32; 2]| {
        let mut f = Fingerprint::default();
        shades.iter().for_each(|s| f.add(&image(*s)));
        f
    };
    let [a, b, c] = [of([0.1, 0.2]), of([0.1, 0.3]), of([0.2, 0.1])];
    let judge = |of: &[&Fingerprint]| judge(["000", "001", "002", "003"].into_iter().zip(of.iter().copied()));
    assert!(judge(&[&a, &b, &c]).is_none());
    let found = judge(&[&b, &a, &b, &c]).unwrap();
    assert!(found.sentence.contains("000 and 002") && found.code == Code::PositionsRepeat, "{found}");
    let found = judge(&[&a, &a, &a, &b]).unwrap();
    assert!(found.sentence.contains("3 board positions"), "{found}");
}
