# mypy: ignore-errors
"""Compiled loops of `neuro_drone.eye`: outlines in the world become exact pixel shares in the picture.

An outline is a flat polygon in the world, which is clipped in front of the camera and projected. In each row, the area
to the right of each edge grows from pixel to pixel; the running sum of this growth is the share of each pixel inside
the outline. No pixel is sampled, so the shares are exact for polygons. The pattern of the ground is filtered instead:
each pixel is the mean of the pattern over about the pixel's size on the ground.

The base is a picture of sky and ground only, which is drawn again if the camera's new pose makes a difference. Line and
ball are painted over a copy of the base.
"""

from math import ceil, floor, log2, pi, sin, sqrt

import numpy as np

from neuro.apps import kernel, subkernel

NEAR = 1e-3
"""Depth at which outlines are clipped in front of the camera, m."""
FAR = 1e6
"""Half a side of the square that approximates the infinite ground, in camera heights. The error is 1e-4 px at the
horizon."""
SAGITTA = 0.002
"""Largest distance between an inscribed polygon and a ball's outline, px. The polygon is scaled to the outline's area,
which halves the distance."""
FEWEST = 64
"""Least number of corners of a ball's outline."""
RUN = 8
"""Neighbouring pixels of a row that share one level of the pattern."""
HIGHEST = 64.0
"""Level of `sharpness` for pixels at or above the horizon; higher than any level of the pattern."""


@subkernel
def project(points, n, matrix, focal, middle, corners):
    """Clip and project an outline. Return the number of corners.

    points: (n, 3), m. corners: output, one row (column, row) per corner, px. Whole numbers are the upper left corners
    of pixels.
    """
    m = 0
    last = points[n - 1]
    depth0, right0, down0 = in_camera(last[0], last[1], last[2], matrix)
    for k in range(n):
        depth1, right1, down1 = in_camera(points[k, 0], points[k, 1], points[k, 2], matrix)
        if (depth0 < NEAR) != (depth1 < NEAR):
            share = (NEAR - depth0) / (depth1 - depth0)
            corners[m, 0] = middle + 0.5 + focal * (right0 + share * (right1 - right0)) / NEAR
            corners[m, 1] = middle + 0.5 + focal * (down0 + share * (down1 - down0)) / NEAR
            m += 1
        if depth1 >= NEAR:
            corners[m, 0] = middle + 0.5 + focal * right1 / depth1
            corners[m, 1] = middle + 0.5 + focal * down1 / depth1
            m += 1
        depth0, right0, down0 = depth1, right1, down1
    return m


@subkernel
def in_camera(x, y, z, matrix):
    """Return the depth of a point and its distances to the right and downwards, m."""
    x -= matrix[3, 0]
    y -= matrix[3, 1]
    z -= matrix[3, 2]
    depth = x * matrix[2, 0] + y * matrix[2, 1] + z * matrix[2, 2]
    right = x * matrix[0, 0] + y * matrix[0, 1] + z * matrix[0, 2]
    return depth, right, x * matrix[1, 0] + y * matrix[1, 1] + z * matrix[1, 2]


@subkernel
def left_of(column, x0, x1):
    """Return the mean of max(0, column - x) over an edge from x0 to x1 >= x0."""
    if column <= x0:
        return 0.0
    if column >= x1:
        return column - 0.5 * (x0 + x1)
    return (column - x0) ** 2 / (2.0 * (x1 - x0))


@subkernel
def fill(corners, n, cover, spans):
    """Add an outline to the pixel shares.

    corners: (n, 2). cover: (height, width), differences of the shares along the rows. spans: (height, 2), first touched
    column of each row, and last + 1.
    """
    height, width = cover.shape
    for k in range(n):
        xa, ya, xb, yb = corners[k - 1, 0], corners[k - 1, 1], corners[k, 0], corners[k, 1]
        if k == 0:
            xa, ya = corners[n - 1, 0], corners[n - 1, 1]
        if ya == yb:
            continue
        sign = 1.0
        if ya > yb:
            xa, ya, xb, yb = xb, yb, xa, ya
            sign = -1.0
        slope = (xb - xa) / (yb - ya)
        for row in range(max(floor(ya), 0), min(ceil(yb), height)):
            top, bottom = max(ya, float(row)), min(yb, row + 1.0)
            x0, x1 = xa + (top - ya) * slope, xa + (bottom - ya) * slope
            if x0 > x1:
                x0, x1 = x1, x0
            first, last = max(floor(min(x0, width)), 0), min(floor(max(x1, -2.0)) + 2, width)
            spans[row, 0] = min(spans[row, 0], first)
            spans[row, 1] = max(spans[row, 1], last, 1)
            row_share = sign * (bottom - top)
            if last <= 0:
                cover[row, 0] += row_share
                continue
            previous_share, area = 0.0, left_of(float(first), x0, x1)
            for column in range(first, last):
                next_area = left_of(column + 1.0, x0, x1)
                share = next_area - area
                cover[row, column] += row_share * (share - previous_share)
                previous_share, area = share, next_area


@subkernel
def blend(shade, cover, spans, image, painted):
    """Paint the filled shares in one shade, clear cover and spans, and add the spans to painted."""
    for row in range(cover.shape[0]):
        first, last = spans[row, 0], spans[row, 1]
        if first >= last:
            continue
        inside = 0.0
        for column in range(first, last):
            inside += cover[row, column]
            cover[row, column] = 0.0
            share = min(abs(inside), 1.0)
            image[row, column] = (1.0 - share) * image[row, column] + share * shade
        painted[row, 0], painted[row, 1] = min(painted[row, 0], first), max(painted[row, 1], last)
        spans[row, 0], spans[row, 1] = cover.shape[1], 0


@subkernel
def ball_outline(ball, matrix, focal, circle, points):
    """Fill points with the circle where rays from the camera touch a ball, as a polygon of the same area.

    ball: x, y, z, radius, m. circle: (n, 2), cosine and sine round the circle, n a power of 2. Return the number of
    points that SAGITTA requires; 0 if the camera is inside the ball or the ball is exactly to its right or left.
    """
    x, y, z, radius = ball[0] - matrix[3, 0], ball[1] - matrix[3, 1], ball[2] - matrix[3, 2], ball[3]
    dist = sqrt(x * x + y * y + z * z)
    if dist <= radius:
        return 0
    x, y, z = x / dist, y / dist, z / dist
    along = x * matrix[0, 0] + y * matrix[0, 1] + z * matrix[0, 2]
    norm = sqrt(max(1.0 - along * along, 0.0))
    if norm < 1e-6:
        return 0
    ax, ay, az = matrix[0, 0] - along * x, matrix[0, 1] - along * y, matrix[0, 2] - along * z
    ax, ay, az = ax / norm, ay / norm, az / norm
    bx, by, bz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
    depth = dist * (x * matrix[2, 0] + y * matrix[2, 1] + z * matrix[2, 2]) - radius
    n = FEWEST
    while n < circle.shape[0] and (depth < radius or focal * radius * dist * (pi / n) ** 2 > 2.0 * SAGITTA * depth**2):
        n *= 2
    plane_offset = radius * radius / dist
    turn = 2.0 * pi / n
    circle_radius = radius * sqrt(1.0 - (radius / dist) ** 2) * sqrt(turn / sin(turn))
    step = circle.shape[0] // n
    for k in range(n):
        c, s = circle_radius * circle[k * step, 0], circle_radius * circle[k * step, 1]
        points[k, 0] = matrix[3, 0] + (dist - plane_offset) * x + c * ax + s * bx
        points[k, 1] = matrix[3, 1] + (dist - plane_offset) * y + c * ay + s * by
        points[k, 2] = matrix[3, 2] + (dist - plane_offset) * z + c * az + s * bz
    return n


@subkernel
def all_ground(matrix, focal, middle):
    """Return whether all corners of the picture show the ground."""
    edge = (middle + 0.5) / focal
    return matrix[2, 2] + edge * (abs(matrix[0, 2]) + abs(matrix[1, 2])) < 0.0


@subkernel
def plain_ground(matrix, focal, middle, shades, work, base):
    """Draw the sky and a ground of one shade."""
    if all_ground(matrix, focal, middle):
        base[:] = shades[1]
        return
    points, corners, cover, spans, _ = work
    base[:] = shades[0]
    reach = FAR * matrix[3, 2]
    for k in range(4):
        points[k, 0] = matrix[3, 0] + (reach if k in (0, 3) else -reach)
        points[k, 1] = matrix[3, 1] + (reach if k < 2 else -reach)
        points[k, 2] = 0.0
    fill(corners, project(points, 4, matrix, focal, middle, corners), cover, spans)
    blend(shades[1], cover, spans, base, spans)


@subkernel
def tilt_changed(matrix, base_pose):
    """Return whether the horizon or the camera's height differs from that of the drawn base."""
    same = matrix[3, 2] == base_pose[3, 2]
    for k in range(3):
        same &= matrix[k, 2] == base_pose[k, 2]
    return not same


@subkernel
def pose_changed(matrix, base_pose):
    """Return whether the camera's pose differs from that of the drawn base."""
    same = True
    for i in range(4):
        for k in range(3):
            same &= matrix[i, k] == base_pose[i, k]
    return not same


@subkernel
def copy(source, target):
    """Copy an array to the first rows of another. Slice assignment would allocate, since slices may overlap."""
    for row in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[row, column] = source[row, column]


@subkernel
def ground(matrix, focal, middle, shades, pattern, work, base_pose, base):
    """Draw sky and ground of the base again if the pose changes them. Return True if they were drawn."""
    levels, size, wide, sharp, x, y = pattern
    stale = base_pose[4, 0] != 0.0
    tilted = stale or tilt_changed(matrix, base_pose)
    if levels.size:
        differs = stale or pose_changed(matrix, base_pose)
    else:
        differs = stale or (tilted and not (all_ground(matrix, focal, middle) and all_ground(base_pose, focal, middle)))
    if not differs:
        return False
    plain_ground(matrix, focal, middle, shades, work, base)
    if levels.size:
        if tilted:
            sharpness(matrix, focal, middle, wide, sharp)
        textured_ground(matrix, focal, middle, levels, size, wide, sharp, x, y, base)
    copy(matrix, base_pose)
    base_pose[4, 0] = 0.0
    return True


@subkernel
def texel(levels, start, mask, i, j):
    """Return a texel of the repeated tile. Unsigned arguments avoid numba's check for negative indices."""
    return levels[start + (j & mask) * (mask + np.uint64(1)) + (i & mask)]


@subkernel
def lookup(levels, start, size, x, y):
    """Return the bilinear mean of the four texels around a point. x, y: texels of this level, centres at halves."""
    left, upper = floor(x - 0.5), floor(y - 0.5)
    a, b = np.float32(x - 0.5 - left), np.float32(y - 0.5 - upper)
    i, j, one, start = np.uint64(left), np.uint64(upper), np.uint64(1), np.uint64(start)
    mask = np.uint64(size - 1)
    upper_left, lower_left = texel(levels, start, mask, i, j), texel(levels, start, mask, i, j + one)
    above = upper_left + a * (texel(levels, start, mask, i + one, j) - upper_left)
    below = lower_left + a * (texel(levels, start, mask, i + one, j + one) - lower_left)
    return above + b * (below - above)


@subkernel
def sharpness(matrix, focal, middle, wide, out):
    """Fill out with log2 of the longer side of a pixel on the ground, in texels, in the middle of each run; >= 0.

    The values do not depend on heading and position. wide: size of a texel, m. out: (height, runs).
    """
    for row in range(out.shape[0]):
        for run in range(out.shape[1]):
            a, b = (run * RUN + 0.5 * (RUN - 1) - middle) / focal, (row - middle) / focal
            fall = -(a * matrix[0, 2] + b * matrix[1, 2] + matrix[2, 2])
            out[row, run] = HIGHEST
            if fall * focal > 1.0:
                x = (a * matrix[0, 0] + b * matrix[1, 0] + matrix[2, 0]) / fall
                y = (a * matrix[0, 1] + b * matrix[1, 1] + matrix[2, 1]) / fall
                across = (matrix[0, 0] + x * matrix[0, 2]) ** 2 + (matrix[0, 1] + y * matrix[0, 2]) ** 2
                along = (matrix[1, 0] + x * matrix[1, 2]) ** 2 + (matrix[1, 1] + y * matrix[1, 2]) ** 2
                square = max(across, along) * (matrix[3, 2] / (focal * fall * wide)) ** 2
                out[row, run] = 0.5 * log2(max(square, 1.0))


@subkernel
def places(row, matrix, focal, middle, x, y):
    """Fill x and y with the points where the pixels of a row meet the ground, m; arbitrary above the horizon."""
    b = (row - middle) / focal
    height = matrix[3, 2]
    for column in range(x.size):
        a = (column - middle) / focal
        fall = -(a * matrix[0, 2] + b * matrix[1, 2] + matrix[2, 2])
        reach = height / (fall if fall * focal > 1.0 else 1.0)
        x[column] = matrix[3, 0] + reach * (a * matrix[0, 0] + b * matrix[1, 0] + matrix[2, 0])
        y[column] = matrix[3, 1] + reach * (a * matrix[0, 1] + b * matrix[1, 1] + matrix[2, 1])


@subkernel
def textured_ground(matrix, focal, middle, levels, size, wide, sharp, x, y, base):
    """Draw the pattern on the ground of a base. Pixels wider than the whole tile keep the base's shade.

    A pixel is the mean over a square with the pixel's longer side on the ground. The two levels of the pattern next to
    this width are interpolated: bilinearly within a level, and between the levels linearly in the logarithm of the
    width.

    levels: result of `eye.pyramid`. size: width of the first level, texels. wide: size of a texel, m. sharp: result of
    `sharpness`. x, y: (width,), buffers.
    """
    top = log2(size)
    for row in range(base.shape[0]):
        places(row, matrix, focal, middle, x, y)
        for run in range(sharp.shape[1]):
            level = sharp[row, run]
            if level >= top:
                continue
            lower = int(level)
            share = np.float32(level - lower)
            side = size >> lower
            start = (size * size - side * side) // 3 * 4
            scale = 1.0 / (wide * (1 << lower))
            for column in range(run * RUN, min(run * RUN + RUN, x.size)):
                fine = lookup(levels, start, side, scale * x[column], scale * y[column])
                coarse = lookup(
                    levels, start + side * side, side >> 1, 0.5 * scale * x[column], 0.5 * scale * y[column]
                )
                base[row, column] = fine + share * (coarse - fine)


@kernel
def paint(matrix, focal, middle, shades, pattern, ball, strips, circle, work, picture):
    """Draw the next picture over the previous one.

    shades: brightness of sky, ground, line and ball. pattern: levels, size, wide, sharp, x and y of `textured_ground`;
    empty levels for plain ground. ball: x, y, z, radius, m; radius 0 for no ball. strips: (n, 4, 2), parts of the line
    on the ground, m. work: buffers. picture: base_pose, base, image and box.

    base_pose: (5, 3), the camera matrix of the base; 1 in the first column of its last row draws everything again. box:
    output, the part that may differ from the previous picture: first column and row, last column and row + 1.
    """
    points, corners, cover, spans, painted = work
    base_pose, base, image, box = picture
    height, width = image.shape
    box[0], box[1], box[2], box[3] = width, height, 0, 0
    if ground(matrix, focal, middle, shades, pattern, work, base_pose, base):
        copy(base, image)
        box[0], box[1], box[2], box[3] = 0, 0, width, height
    for row in range(height):
        first, last = painted[row]
        if first < last:
            widen(box, row, first, last)
            for column in range(first, last):
                image[row, column] = base[row, column]
            painted[row, 0], painted[row, 1] = width, 0
    for i in range(strips.shape[0]):
        for k in range(4):
            points[k, 0], points[k, 1], points[k, 2] = strips[i, k, 0], strips[i, k, 1], 0.0
        fill(corners, project(points, 4, matrix, focal, middle, corners), cover, spans)
    blend(shades[2], cover, spans, image, painted)
    if ball[3] > 0.0:
        n = ball_outline(ball, matrix, focal, circle, points)
        fill(corners, project(points, n, matrix, focal, middle, corners) if n else 0, cover, spans)
        blend(shades[3], cover, spans, image, painted)
    for row in range(height):
        if painted[row, 0] < painted[row, 1]:
            widen(box, row, painted[row, 0], painted[row, 1])
    if box[0] >= box[2]:
        box[:] = 0


@subkernel
def widen(box, row, first, last):
    """Extend a box by columns of a row."""
    box[0], box[2] = min(box[0], first), max(box[2], last)
    box[1], box[3] = min(box[1], row), max(box[3], row + 1)
