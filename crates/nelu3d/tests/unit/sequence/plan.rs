use nelu3d::sequence::{Plan, Shard};

#[test]
fn parts_are_whole_stretches_and_cover_everything_once() {
    for (frames, keyframe, of) in [(60, 10, 4), (61, 10, 4), (7, 3, 2), (5, 30, 3), (1, 1, 1), (100, 1, 7)] {
        let plan = Plan { frames, keyframe };
        let mut next = 0;
        for index in 1..=of {
            let part = plan.part(Shard { index, of });
            assert_eq!(part.start, next);
            assert!(part.is_empty() || plan.is_key(part.start));
            next = part.end;
        }
        assert_eq!(next, frames);
    }
}

#[test]
fn shards_are_read_as_written() {
    assert_eq!("2/8".parse(), Ok(Shard { index: 2, of: 8 }));
    assert_eq!(Shard { index: 2, of: 8 }.to_string(), "2/8");
    for wrong in ["0/3", "4/3", "1", "a/b", "1/0", "-1/2", ""] {
        assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
    }
}
