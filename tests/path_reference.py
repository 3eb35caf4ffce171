"""Loops of the path of a program in plain Python: the compiled ones give the same bits."""

import numpy as np


def add_rows(first, rows, weight, dim, band):
    """Add sum_k weight[k] rows[k] rows[k]^T to the band."""
    width = rows.shape[1]
    for k in range(first.size):
        start = first[k] * dim
        for j in range(width):
            value = weight[k] * rows[k, j]
            if value != 0.0:
                for i in range(j, width):
                    band[i - j, start + j] += value * rows[k, i]


def apply_rows(first, rows, x, dim, out):
    """Write rows[k] . x into out[k]."""
    width = rows.shape[1]
    for k in range(first.size):
        start = first[k] * dim
        total = 0.0
        for j in range(width):
            total += rows[k, j] * x[start + j]
        out[k] = total


def add_transposed(first, rows, y, dim, out):
    """Add sum_k y[k] rows[k] to out."""
    width = rows.shape[1]
    for k in range(first.size):
        start = first[k] * dim
        for j in range(width):
            out[start + j] += y[k] * rows[k, j]


def apply_band(band, x, out):
    """Write the product of the symmetric band and x into out."""
    n = x.size
    for j in range(n):
        out[j] = band[0, j] * x[j]
    for i in range(1, band.shape[0]):
        for j in range(n - i):
            out[j + i] += band[i, j] * x[j]
            out[j] += band[i, j] * x[j + i]


def to_segment(p, lo, hi, start, direction):
    """Squared distance from p to the points start + x direction, lo <= x <= hi, of a unit direction."""
    x = 0.0
    for j in range(p.size):
        x += (p[j] - start[j]) * direction[j]
    x = min(max(x, lo), hi)
    total = 0.0
    for j in range(p.size):
        total += (start[j] + x * direction[j] - p[j]) ** 2
    return total


def to_curve(p, lo, hi, vectors, rates):
    """Squared distance from p to a curved leg between lo and hi: scanned, then Gauss-Newton on the nearest part."""
    w, k = rates[0], rates[1]
    count = 1 + int(abs(w) * (hi - lo) / 0.5)
    best, at = 1e300, lo
    for i in range(count + 1):
        x = lo + (hi - lo) * i / count
        c, s = np.cos(w * x), np.sin(w * x)
        total = 0.0
        for j in range(p.size):
            total += (
                vectors[0, j] + (1.0 + k * x) * (vectors[1, j] * c + vectors[2, j] * s) + vectors[3, j] * x - p[j]
            ) ** 2
        if total < best:
            best, at = total, x
    x = at
    for _ in range(8):
        c, s = np.cos(w * x), np.sin(w * x)
        slope = square = bend = 0.0
        for j in range(p.size):
            circle = vectors[1, j] * c + vectors[2, j] * s
            along = w * (vectors[2, j] * c - vectors[1, j] * s)
            away = vectors[0, j] + (1.0 + k * x) * circle + vectors[3, j] * x - p[j]
            d1 = (1.0 + k * x) * along + k * circle + vectors[3, j]
            d2 = 2.0 * k * along - (1.0 + k * x) * w * w * circle
            slope += away * d1
            square += d1 * d1
            bend += away * d2
        curvature = square + bend
        if curvature < 0.1 * square:
            curvature = square
        x = min(max(x - slope / curvature, lo), hi)
        c, s = np.cos(w * x), np.sin(w * x)
        total = 0.0
        for j in range(p.size):
            total += (
                vectors[0, j] + (1.0 + k * x) * (vectors[1, j] * c + vectors[2, j] * s) + vectors[3, j] * x - p[j]
            ) ** 2
        best = min(best, total)
    return best


def distance_to_blocks(edges, vectors, rates, points, abscissa, window, out):
    """Distance of every point to the blocks between abscissa - window and abscissa + window.

    Block i covers edges[i] to edges[i + 1]; ``vectors`` and ``rates`` are those of its leg.
    """
    last = edges.size - 2
    for n in range(points.shape[0]):
        low, high = abscissa[n] - window[n], abscissa[n] + window[n]
        lo, hi = 0, last + 1
        while hi - lo > 1:
            mid = (lo + hi) // 2
            if edges[mid] <= low:
                lo = mid
            else:
                hi = mid
        best = 1e300
        i = lo
        while i <= last and (edges[i] <= high or i == lo):
            begin = max(0.0, low - edges[i])
            end = min(edges[i + 1], high) - edges[i]
            if rates[i, 0] == 0.0:
                best = min(best, to_segment(points[n], begin, end, vectors[i, 0], vectors[i, 3]))
            else:
                best = min(best, to_curve(points[n], begin, end, vectors[i], rates[i]))
            i += 1
        out[n] = np.sqrt(best)


def strip_width(points, rows, i, j, share):
    """Distance of the blocks i to j - 1 from one line between their ends; inf where they may not become that line.

    ``rows`` (m, 6) holds of every block its length, the distance of its points from its chord, its feed, its tolerance, the
    distance it is off already, and the length below which its feed may be that of its longest neighbour.  Points of the
    line go with the vertices in their order, so the distance holds in both directions.
    """
    if j == i + 1:
        return rows[i, 4]
    dim = points.shape[1]
    square, longest, least, off = 0.0, i, rows[i, 3], 0.0
    for a in range(dim):
        square += (points[j, a] - points[i, a]) ** 2
    for k in range(i, j):
        longest = k if rows[k, 0] > rows[longest, 0] else longest
        least = min(least, rows[k, 3])
        off = max(off, rows[k, 1] + rows[k, 4])
    if square == 0.0 or off > share * least:
        return np.inf
    room = share * least - off
    along = 0.0
    worst = 0.0
    for k in range(i, j):
        if rows[k, 2] != rows[longest, 2] and rows[k, 0] > rows[k, 5]:
            return np.inf
        if k > i:
            at = 0.0
            for a in range(dim):
                at += (points[k, a] - points[i, a]) * (points[j, a] - points[i, a])
            along = min(1.0, max(along, at / square))
            away = 0.0
            for a in range(dim):
                away += (points[k, a] - points[i, a] - along * (points[j, a] - points[i, a])) ** 2
            worst = max(worst, away)
            if worst > room * room:
                return np.inf
    return np.sqrt(worst) + off


def slide(points, rows, loose, share, begin, end, kept):
    """Move every vertex that stays between begin and end to the neighbour that leaves the least distance."""
    before, k = begin, begin + 1
    while k < end:
        if kept[k] and loose[k]:
            after = k + 1
            while not kept[after]:
                after += 1
            best, place = np.inf, k
            for c in range(max(before + 1, k - 16), min(after, k + 16 + 1)):
                width = max(strip_width(points, rows, before, c, share), strip_width(points, rows, c, after, share))
                if width < best:
                    best, place = width, c
            kept[k], kept[place] = 0, 1
            before = place
            k = max(k, place)
        k += 1


def absorb_runs(points, rows, loose, share, kept):
    """Choose the vertices that stay.

    Between two vertices that are not loose, lines as long as possible within ``share`` of the tolerance replace the blocks;
    then each vertex between two of them moves to the neighbour that leaves the least distance.
    """
    last = rows.shape[0]
    kept[:] = 1
    begin = 0
    while begin < last:
        end = begin + 1
        while end < last and loose[end]:
            end += 1
        if end > begin + 1:
            i = begin
            while i < end:
                # zigzags lie about their mean, not about the lines between their vertices: the long lines come first
                step = end - i if i == begin else min(end - i, 1024)
                failed = step + 1
                while step > 1 and strip_width(points, rows, i, i + step, share) == np.inf:
                    failed, step = step, step // 2
                while failed - step > 1:
                    middle = (step + failed) // 2
                    if strip_width(points, rows, i, i + middle, share) < np.inf:
                        step = middle
                    else:
                        failed = middle
                j = i + step
                for k in range(i + 1, j):
                    kept[k] = 0
                i = j
            slide(points, rows, loose, share, begin, end, kept)
        begin = end
