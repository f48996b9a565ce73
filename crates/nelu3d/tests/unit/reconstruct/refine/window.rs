use nelu3d::reconstruct::refine::window::Window;

#[test]
fn it_holds_the_finite_values_and_a_ring() {
    let mut map = vec![f32::NAN; 60];
    assert!(Window::around(&map, 10).is_none());
    for i in [0, 13, 21] {
        map[i] = 1.0;
    }
    let win = Window::around(&map, 10).unwrap();
    assert_eq!((win.w, win.h), (6, 5));
    let inside: Vec<usize> = (0..win.w * win.h).filter(|i| !win.in_ring(*i)).map(|i| win.at(i)).collect();
    assert_eq!(inside, [0, 1, 2, 3, 10, 11, 12, 13, 20, 21, 22, 23]);
}
