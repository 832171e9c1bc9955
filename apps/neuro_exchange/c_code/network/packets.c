        |/* A spike of source i of '@of@': update the row of the source, then send the spike. */
        |static void packet_@q@(uint32_t i)
        |{
        |    uint32_t t = (uint32_t)(now - 1u), p = last_@q@[i];
        |    int32_t r1 = 0, r2 = 0;
traced  |    r1 = r1_@q@[i];
traced  |    r1_@q@[i] = (int16_t)half(fine(r1, left(@plus@, t - p)) + 2048);
triplet |    if (p != 0) r2 = half(fine(r2_@q@[i] + 2048, left(@x@, t - p)));
triplet |    r2_@q@[i] = (int16_t)r2;
        |    last_@q@[i] = t;
        |@rows@
        |    send_@q@(i, 1u);
        |}
        |
        |static void learn_@q@(void)
        |{
        |    for (uint32_t i = 0; i < @sources@u; i++) {
        |        for (; sent_@q@[i] != 0; sent_@q@[i]--) packet_@q@(i);
        |    }
        |}
