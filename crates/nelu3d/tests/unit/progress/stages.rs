use nelu3d::progress::{Progress, StageClock};

#[test]
fn a_pause_is_not_counted() {
    let progress = Progress::none();
    let mut clock = StageClock::new(&progress);
    clock.begin("one");
    clock.pause();
    std::thread::sleep(std::time::Duration::from_millis(60));
    clock.resume();
    clock.resume();
    clock.begin("two");
    std::thread::sleep(std::time::Duration::from_millis(30));
    let stages = clock.finish();
    assert_eq!(stages.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["one", "two"]);
    assert!(stages[0].wall_secs < 0.05, "{stages:?}");
    assert!(stages[1].wall_secs >= 0.03, "{stages:?}");
}
