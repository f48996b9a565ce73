// Where a thread is in its workgroup.
struct Place {
    @builtin(local_invocation_index) thread: u32,
#if SUBGROUPS
    @builtin(subgroup_invocation_id) lane: u32,
    @builtin(subgroup_id) wave: u32,
    @builtin(num_subgroups) waves: u32,
#endif
}
