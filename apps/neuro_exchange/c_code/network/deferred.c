        |/* The learning rule of synapses onto '@onto@'. Events of a target neuron are appended to its history: entry 0 is a
        | * placeholder, entries 1 to 15 are the last events. Synapses read the history when their source spikes. */
        |static void append_@k@(uint32_t j, uint32_t t, int32_t concentration, uint32_t dopamine)
        |{
        |    uint32_t n = count_@k@[j], first = j * 16u, last = first + n - 1u, passed = t - times_@k@[last];
traced  |    int32_t fast = fine(fast_@k@[last], left(@minus@, passed)) + (dopamine != 0 ? 0 : 2048);
triplet |    int32_t slow = fine(slow_@k@[last] + (spike_@k@[j] != 0 ? 2048 : 0),
triplet |                        left(@y@, spike_@k@[j] != 0 ? t - spike_@k@[j] : passed));
taught  |    int32_t level = fine(level_@k@[last], left(@d@, passed)) + concentration;
        |    (void)passed, (void)concentration, (void)dopamine;
        |    if (n == 16u) {
        |        n--;
        |        memmove(times_@k@ + first + 1, times_@k@ + first + 2, 14u * sizeof *times_@k@);
traced  |        memmove(fast_@k@ + first + 1, fast_@k@ + first + 2, 14u * sizeof *fast_@k@);
triplet |        memmove(slow_@k@ + first + 1, slow_@k@ + first + 2, 14u * sizeof *slow_@k@);
taught  |        memmove(level_@k@ + first + 1, level_@k@ + first + 2, 14u * sizeof *level_@k@);
taught  |        marks_@k@[j] = (uint16_t)(marks_@k@[j] >> 1);
        |    }
        |    times_@k@[first + n] = t;
traced  |    fast_@k@[first + n] = (int16_t)half(fast);
triplet |    slow_@k@[first + n] = (int16_t)half(slow);
triplet |    spike_@k@[j] = t;
taught  |    level_@k@[first + n] = (int16_t)half(level);
taught  |    marks_@k@[j] = (uint16_t)(marks_@k@[j] | dopamine << n);
        |    count_@k@[j] = (uint8_t)(n + 1u);
        |}
        |
        |static int32_t raised_@k@(int32_t w, int32_t x, int32_t triplet)
        |{
        |    (void)triplet;
mult    |    return wrap32((int64_t)w + times_fine(coarse(wrap32(@high@ - (int64_t)w), @up@), x));
add     |    int32_t sum = wrap32((int64_t)w + times_fine(@up@, x) + times_fine(@up_triplet@, triplet));
add     |    return sum < @high@ ? sum : @high@;
        |}
        |
lowers  |static int32_t lowered_@k@(int32_t w, int32_t x, int32_t triplet)
lowers  |{
lowers  |    (void)triplet;
lowmult |    return wrap32((int64_t)w - times_fine(coarse(wrap32((int64_t)w - @low@), @down@), x));
lowadd  |    int32_t sum = wrap32((int64_t)w - times_fine(@down@, x) - times_fine(@down_triplet@, triplet));
lowadd  |    return sum > @low@ ? sum : @low@;
lowers  |}
lowers  |
taught  |/* Advance by some ticks from a level of dopamine. The order of products is that of the released programs. */
taught  |static void elapse_@k@(int32_t *w, int32_t *c, int32_t level, uint32_t ticks)
taught  |{
taught  |    int32_t kept = left(@c@, ticks), lost = half(fine(kept, left(@d@, ticks)) - 2048);
taught  |    if (level != 0) *w = wrap32((int64_t)*w + times_fine(times_fine(coarse(*c, @gain@), level), lost));
taught  |    *c = times_fine(*c, kept);
taught  |}
taught  |
        |/* Update a synapse onto neuron j with delay d to tick t. p and r1 are of the last packet, r2 of this one. */
        |static void visit_@k@(uint16_t *weight, uint16_t *tag, uint32_t j, uint32_t d, unsigned shift, uint32_t t, uint32_t p,
        |                      int32_t r1, int32_t r2)
        |{
        |    const uint32_t *times = times_@k@ + j * 16u;
        |    uint32_t n = count_@k@[j], begin = p > d ? p - d : 0u, end = t > d ? t - d : 0u, before = n - 1u, newest;
        |    int32_t w = (int32_t)((uint32_t)*weight << shift), x;
taught  |    int32_t c = (int32_t)((uint32_t)*tag << shift), level = 0;
taught  |    uint32_t at = p, marks = marks_@k@[j], marks_left;
        |    (void)tag, (void)r1, (void)r2;
        |    while (before > 0 && times[before] > begin) before--;
        |    for (newest = before; newest + 1u < n && times[newest + 1u] <= end;) newest++;
taught  |    /* Without the delay; marks are shifted by the entries after the window. Both as in the released programs. */
taught  |    if (before > 0) level = fine(level_@k@[j * 16u + before], left(@d@, p - times[before]));
taught  |    marks >>= n - (newest - before);
        |    for (uint32_t k = before + 1u; k <= newest; k++) {
        |        uint32_t u = times[k] + d;
taught  |        elapse_@k@(&w, &c, level, u - at);
taught  |        at = u;
taught  |        level = level_@k@[j * 16u + k];
taught  |        marks_left = marks;
taught  |        marks >>= 1;
taught  |        if ((marks_left & 1u) != 0) continue;
        |        x = left(@plus@, u - p);
nearest |        if (u - times[k - 1u] < u - p) x = 0;
traced  |        x = fine(r1, x);
        |        @moved@ = raised_@k@(@moved@, x, @post_triplet@);
        |    }
        |    if (newest > 0) {
taught  |        elapse_@k@(&w, &c, level, t - at);
        |        x = left(@minus@, t - (times[newest] + d));
traced  |        x = fine(fast_@k@[j * 16u + newest], x);
vogels  |        @moved@ = raised_@k@(@moved@, x - @alpha@, 0); /* may be negative: there is no lower bound */
lowers  |        @moved@ = lowered_@k@(@moved@, x, @pre_triplet@);
        |    }
taught  |    w = clipped(w, @taught_low@, @taught_high@);
taught  |    *tag = (uint16_t)floor_shift(c, shift);
        |    *weight = (uint16_t)floor_shift(w, shift);
        |}
        |
        |/* Append the dopamine and the target spikes of a step. */
        |static void events_@k@(void)
        |{
        |    uint32_t t = (uint32_t)(now - 1u);
        |    for (uint32_t j = 0; j < @size@u; j++) {
sent    |        for (uint32_t k = 0; k < due_@k@[@due@]; k++) append_@k@(j, t, @concentration@, 1u);
        |        if (heard_@k@[j] != 0) append_@k@(j, t, 0, 0u);
        |        heard_@k@[j] = 0;
        |    }
sent    |    memset(due_@k@, 0, sizeof due_@k@);
        |}
        |
signal  |/* Set the dopamine of neuron j by spikes of sources of reward or punishment, as the host of the machine does.
signal  | * `halves` is twice the value in s4.11, rounded down. */
signal  |static void modulate_@k@(uint32_t j, int32_t value)
signal  |{
signal  |    uint32_t t = (uint32_t)now, last = j * 16u + count_@k@[j] - 1u;
signal  |    int32_t halves = (int32_t)floor_shift(clipped(value, -@most@, @most@) * @factor@, @places@u), missing, size;
ties    |    uint64_t upper = UINT64_MAX;
ties    |    for (uint32_t k = 0; k < @ties@u; k++) {
ties    |        if (ties_@k@[k].value == value) halves = ties_@k@[k].halves, upper = ties_@k@[k].upper;
ties    |    }
signal  |    halves -= 2 * fine(level_@k@[last], left(@d@, t - times_@k@[last])) - @unit@;
signal  |    missing = floor_div(halves, 2 * @unit@);
ties    |    /* Half-way between two levels. */
ties    |    if (halves == missing * 2 * @unit@ && missing > -@levels@ && missing <= @levels@) {
ties    |        missing -= (upper >> (missing + @levels@ - 1) & 1u) == 0;
ties    |    }
signal  |    missing = clipped(missing, -@levels@, @levels@);
signal  |    size = missing < 0 ? -missing : missing;
signal  |    for (unsigned bit = 0; bit < @bits@u; bit++) {
signal  |        int32_t amount = @unit@ * (1 << bit);
signal  |        if ((size >> bit & 1) != 0) append_@k@(j, t, missing < 0 ? -amount : amount, 1u);
signal  |    }
signal  |}
