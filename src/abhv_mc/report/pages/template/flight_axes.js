"use strict";
// Plots of flights on a canvas: axes with round ticks, marks or counted cells, limit lines, and bars of dispersions.
const flightAxes = (() => {
  // Number with a fixed number of significant digits, without exponent.
  const fixed = (value, digits = 4) => {
    if (!Number.isFinite(value)) return "none";
    const places = value ? digits - 1 - Math.floor(Math.log10(Math.abs(value))) : 0;
    return value.toFixed(Math.min(Math.max(places, 0), 8)).replace("-", "\u2212");
  };
  const text = (value, digits = 4) => (Number.isFinite(value) ? String(Number(value.toPrecision(digits))).replace("-", "\u2212") : "none");
  const labelOf = (entry) => (entry.unit ? `${entry.label} (${entry.unit})` : entry.label);

  // Round numbers between two ends, at most `most` of them.
  const ticks = (low, high, most) => {
    const least = (high - low) / most;
    if (!(least > 0)) return [low];
    const power = 10 ** Math.floor(Math.log10(least));
    const step = power * [1, 2, 5, 10].find((part) => part * power >= least);
    const [first, last] = [Math.ceil(low / step - 1e-6), Math.floor(high / step + 1e-6)];
    return Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
  };

  const ready = (canvas) => {
    const scale = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [canvas.clientWidth * scale, canvas.clientHeight * scale];
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    return pen;
  };

  // Conversion between values and canvas positions; a margin keeps marks at the ends visible.
  const frame = (canvas, ends) => {
    const [left, top, right, bottom] = [64, 10, 16, 44];
    const [wide, high] = [canvas.clientWidth - left - right, canvas.clientHeight - top - bottom];
    const [[x0, x1], [y0, y1]] = ends.map(([low, high]) => {
      const room = 0.025 * (high - low) || Math.abs(low) / 2 || 1;
      return [low - room, high + room];
    });
    return { left, top, wide, high, xs: [x0, x1], ys: [y0, y1],
      px: (v) => left + (wide * (v - x0)) / (x1 - x0), py: (v) => top + high * (1 - (v - y0) / (y1 - y0)),
      x: (p) => x0 + ((x1 - x0) * (p - left)) / wide, y: (p) => y0 + (y1 - y0) * (1 - (p - top) / high) };
  };

  const cross = new Path2D("M-4-4L4 4M-4 4L4-4");
  const drawMark = (pen, x, y, path, size, hollow = false) => {
    pen.save();
    pen.translate(x, y);
    pen.scale(size, size);
    if (path === cross || hollow) { pen.lineWidth = path === cross ? 2 : 1; pen.stroke(path); } else pen.fill(path);
    pen.restore();
  };

  const drawGrid = (pen, box, x, y, style) => {
    pen.font = `12px ${style.font}`;
    pen.lineWidth = 1;
    pen.strokeStyle = style.line();
    pen.fillStyle = style.ink();
    pen.textAlign = "center";
    for (const value of ticks(...box.xs, box.wide / 70)) {
      const at = box.px(value);
      pen.strokeRect(at, box.top, 0, box.high);
      pen.fillText(text(value, 6), at, box.top + box.high + 16);
    }
    pen.fillText(labelOf(x), box.left + box.wide / 2, box.top + box.high + 36);
    pen.textAlign = "right";
    for (const value of ticks(...box.ys, box.high / 40)) {
      const at = box.py(value);
      pen.strokeRect(box.left, at, box.wide, 0);
      pen.fillText(text(value, 6), box.left - 6, at + 4);
    }
    pen.save();
    pen.textAlign = "center";
    pen.translate(13, box.top + box.high / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(labelOf(y), 0, 0);
    pen.restore();
  };

  const drawLimits = (pen, box, x, y, style) => {
    pen.strokeStyle = pen.fillStyle = style.ink();
    pen.lineWidth = 1.5;
    pen.setLineDash([6, 4]);
    for (const limit of y.limits.filter((v) => v >= box.ys[0] && v <= box.ys[1])) pen.strokeRect(box.left, box.py(limit), box.wide, 0);
    for (const limit of x.limits.filter((v) => v >= box.xs[0] && v <= box.xs[1])) pen.strokeRect(box.px(limit), box.top, 0, box.high);
    pen.setLineDash([]);
    pen.textAlign = "right";
    const far = y.limits.filter((v) => v < box.ys[0] || v > box.ys[1]);
    for (const limit of y.limits.filter((v) => !far.includes(v))) pen.fillText(`limit ${text(limit)} ${y.unit}`, box.left + box.wide - 4, box.py(limit) - 4);
    far.forEach((limit, i) => pen.fillText(`${limit > box.ys[1] ? "\u2191" : "\u2193"} limit ${text(limit)} ${y.unit}`, box.left + box.wide - 4, limit > box.ys[1] ? box.top + 14 + 14 * i : box.top + box.high - 6));
  };

  // `layers`: counts and their opacity, from back to front; `open`: opened flights as [controller, x, y].
  const drawScatter = (canvas, { x, y, ends, layers, open, controllers, cells, style }) => {
    const [pen, box] = [ready(canvas), frame(canvas, ends)];
    const scale = Math.min(1, 0.35 + box.wide / 1400); // smaller marks on narrow screens
    drawGrid(pen, box, x, y, style);
    pen.save();
    pen.beginPath();
    pen.rect(box.left, box.top, box.wide, box.high);
    pen.clip();
    for (const [found, opacity] of layers) {
      const most = Math.max(1, ...found.cells.map((cell) => cell[3]));
      const [[x0, x1], [y0, y1]] = found.ends;
      const [dx, dy] = [((x1 - x0) || 1) / cells[0], ((y1 - y0) || 1) / cells[1]];
      for (const [k, i, j, n] of found.cells) {
        pen.globalAlpha = opacity * (0.15 + (0.85 * Math.log1p(n)) / Math.log1p(most));
        pen.fillStyle = controllers[k].color;
        const [left, top] = [box.px(x0 + i * dx), box.py(y0 + (j + 1) * dy)];
        pen.fillRect(left, top, Math.ceil(box.px(x0 + (i + 1) * dx) - left), Math.ceil(box.py(y0 + j * dy) - top));
      }
      pen.globalAlpha = opacity;
      // The first controller is drawn on top, as dots within the larger outlines of the other controllers.
      for (let k = controllers.length - 1; k >= 0; k -= 1) {
        pen.fillStyle = pen.strokeStyle = controllers[k].color;
        for (const [, a, b, , lost] of found.points.filter((point) => point[0] === k)) {
          drawMark(pen, box.px(a), box.py(b), lost ? cross : controllers[k].path, scale * (k && !lost ? 0.95 : 0.6), k > 0);
        }
      }
    }
    pen.globalAlpha = 1;
    for (const [k, a, b] of open) {
      pen.fillStyle = style.ink();
      drawMark(pen, box.px(a), box.py(b), controllers[k].path, 2.2);
      pen.fillStyle = controllers[k].color;
      drawMark(pen, box.px(a), box.py(b), controllers[k].path, 1.5);
    }
    pen.restore();
    drawLimits(pen, box, x, y, style);
    return box;
  };

  // All flights are grey. Selected flights are blue and scaled to their own highest bar, whose count is at the left end.
  const drawStrip = (canvas, { all, chosen, ends, open, bars, style }) => {
    const [pen, wide, high] = [ready(canvas), canvas.clientWidth, canvas.clientHeight - 16];
    const most = (counts) => Math.max(1, ...counts.map((bar) => bar[1]));
    const top = 13;
    pen.font = `11px ${style.font}`;
    pen.strokeStyle = pen.fillStyle = style.ink();
    pen.fillText(`highest bar: ${most(chosen)} ${most(chosen) === 1 ? "flight" : "flights"}`, 0, top - 3);
    pen.strokeRect(0, high, wide, 0);
    for (const value of ticks(...ends, wide / 60)) {
      const at = (wide * (value - ends[0])) / (ends[1] - ends[0] || 1);
      pen.strokeRect(at, high, 0, 3);
      pen.textAlign = at < 14 ? "left" : at > wide - 14 ? "right" : "center";
      pen.fillText(text(value, 6), at, high + 14);
    }
    for (const [counts, color, alpha] of [[all, style.ink(), 0.25], [chosen, style.link(), 0.75]]) {
      const scale = (high - top) / most(counts);
      pen.globalAlpha = alpha;
      pen.fillStyle = color;
      for (const [bar, n] of counts) pen.fillRect((wide * bar) / bars, high - scale * n, wide / bars, scale * n);
    }
    pen.globalAlpha = 1;
    pen.fillStyle = style.ink();
    for (const value of open) if (Number.isFinite(value)) pen.fillRect((wide * (value - ends[0])) / (ends[1] - ends[0] || 1) - 1, 0, 2, high);
  };

  return { text, fixed, ticks, labelOf, drawScatter, drawStrip };
})();
