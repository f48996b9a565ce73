// Occupancy: the next batch of the picked cells. RESTART: before they are picked; DONE: the number of samples is again
// what it was.

@group(0) @binding(0) var<storage, read_write> control: array<u32>;

@compute @workgroup_size(1)
fn main() {
#if RESTART
    control[PICKED_AT] = 0u;
    control[BATCH_AT] = 0u;
    control[SAVED_AT] = control[N_AT];
#endif
#if DONE
    control[N_AT] = control[SAVED_AT];
#endif
#if NEXT
    let begin = control[BATCH_AT];
    let n = min(control[PICKED_AT] - min(begin, control[PICKED_AT]), CAPACITY);
    control[BEGIN_AT] = begin;
    control[BATCH_AT] = begin + n;
    control[N_AT] = n;
#endif
}
