// The sum of all values of a workgroup of 256 threads, once all threads have come here.
// TOTAL is the type of a value. To be called once in a kernel.

#if SUBGROUPS
// A subgroup has four threads at least.
var<workgroup> totals: array<TOTAL, 64>;

fn total(value: TOTAL, at: Place) -> TOTAL {
    let sum = subgroupAdd(value);
    if (at.lane == 0u) { totals[at.wave] = sum; }
    workgroupBarrier();
    var all = totals[0];
    for (var j = 1u; j < at.waves; j++) { all += totals[j]; }
    return all;
}
#else
var<workgroup> totals: array<TOTAL, 256>;

fn total(value: TOTAL, at: Place) -> TOTAL {
    totals[at.thread] = value;
    workgroupBarrier();
    for (var reach = 128u; reach > 0u; reach /= 2u) {
        if (at.thread < reach) { totals[at.thread] += totals[at.thread + reach]; }
        workgroupBarrier();
    }
    return totals[0];
}
#endif
