static uint32_t best_@k@(uint32_t first, uint32_t last, uint32_t apart)
{
    uint64_t base = step_word(UINT64_C(@tie@), now), best_drawn = 0;
    int64_t best_margin = 0;
    uint32_t best = @none@;
    for (uint32_t i = first; i < last; i += apart) {
        if (fired_@k@[i]) {
            int64_t margin = (int64_t)v_@k@[i] - @threshold@;
            uint64_t drawn = draw(base, i) >> 11;
            int equal = margin == best_margin && drawn > best_drawn;
            if (best == @none@ || margin > best_margin || equal) {
                best = i, best_margin = margin, best_drawn = drawn;
            }
        }
    }
    return best;
}

