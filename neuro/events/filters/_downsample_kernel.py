# mypy: ignore-errors
"""Sums of blocks of pixels."""

from neuro.kernels.jit import kernel


@kernel
def join(t, x, y, p, columns, rows, threshold, sums, out_t, out_x, out_y, out_p):
    """columns: uint16[width], rows: uint16[height], block of each; sums: int64[blocks down, across].

    out_*: of the length of t. Returns how many events were written.
    """
    n = 0
    for k in range(t.shape[0]):
        column, row = columns[x[k]], rows[y[k]]
        total = sums[row, column] + (1 if p[k] else -1)
        if abs(total) >= threshold:
            out_t[n], out_x[n], out_y[n], out_p[n] = t[k], column, row, p[k]
            n += 1
            total = 0
        sums[row, column] = total
    return n
