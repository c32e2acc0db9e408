// Animation of the path and attitude of flights in three dimensions on a canvas: the path, its shadow on the ground, and
// the body axes. Horizontal distances are to scale, the altitude is stretched, and the vehicle is drawn enlarged.
const flightPath = (host, style) => {
  const NEEDED = ["north_m", "east_m", "altitude_m", "heading_deg", "flight_path_angle_deg", "bank_deg", "angle_of_attack_deg", "sideslip_deg"];
  const ANGLES = NEEDED.slice(3);
  const LASTS = 15; // duration of the animation, s
  const { text, ticks } = flightAxes;
  const [turn, dot] = [Math.PI / 180, (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0)];

  // Return the three body axes as [north, east, down]. The angle of attack and the sideslip relate wind axes to body axes;
  // heading, path angle and bank relate wind axes to north, east and down.
  const attitude = ({ heading_deg: heading, flight_path_angle_deg: climb, bank_deg: bank, angle_of_attack_deg: attack, sideslip_deg: slip }) => {
    const [[sh, ch], [sc, cc], [sb, cb], [sa, ca], [ss, cs]] = [heading, climb, bank, attack, slip].map((angle) => [Math.sin(turn * angle), Math.cos(turn * angle)]);
    const wind = [[cc * ch, sb * sc * ch - cb * sh, cb * sc * ch + sb * sh], [cc * sh, sb * sc * sh + cb * ch, cb * sc * sh - sb * ch], [-sc, sb * cc, cb * cc]];
    const body = [[ca * cs, -ca * ss, -sa], [ss, cs, 0], [sa * cs, -sa * ss, ca]];
    return body.map((axis) => wind.map((row) => dot(row, axis)));
  };

  // State of a flight at a time, interpolated between samples (angles along the shorter arc); after the end, the last sample.
  const sample = ({ time, channels, last }, moment) => {
    const t = Math.min(moment, time[last]);
    let k = time.findIndex((value) => value >= t);
    k = k < 0 ? last : Math.min(Math.max(k, 1), last);
    const share = last ? (t - time[k - 1]) / (time[k] - time[k - 1]) : 0;
    return Object.fromEntries(NEEDED.map((name) => {
      const [from, to] = [channels[name][Math.max(k - 1, 0)], channels[name][k]];
      const step = ANGLES.includes(name) ? ((((to - from) % 360) + 540) % 360) - 180 : to - from;
      return [name, from + share * step];
    }));
  };

  host.innerHTML = `<h4>In space</h4>
    <canvas class="marks" tabindex="0" role="img" aria-label="Path and attitude in three dimensions; arrow keys turn the view"></canvas>
    <div class="controls"><button type="button">Play</button> <label>Time <input type="range" min="0" value="0"></label> <output></output></div>
    <p class="bounds"></p>`;
  const [canvas, button, slider, said, words] = ["canvas", "button", "input", "output", "p"].map((name) => host.querySelector(name));
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let flights = [];
  let view = { azimuth: 35, elevation: 20 }; // deg
  let [stretch, ground, moment, end, playing] = [1, 0, 0, 0, 0];

  // Projection of east, north and up to the right and upward directions of the canvas.
  const project = ([east, north, up]) => {
    const [a, e] = [view.azimuth * turn, view.elevation * turn];
    return [east * Math.cos(a) - north * Math.sin(a), (east * Math.sin(a) + north * Math.cos(a)) * Math.sin(e) + up * Math.cos(e)];
  };
  const place = (at) => [at.east_m, at.north_m, (at.altitude_m - ground) * stretch];
  const below = ([east, north]) => [east, north, 0];

  const drawLine = (pen, points, color, width, dash = []) => {
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.setLineDash([]);
  };

  // Draw the vehicle, not to scale, as a dart with a fin and the body axes x (nose), y (right) and z (down).
  const drawVehicle = (pen, [x, y], at, color, size) => {
    const axes = attitude(at).map(([north, east, down]) => project([east, north, -down]));
    const point = (along, right, down) => [x, y].map((value, i) => value + (i ? -size : size) * (along * axes[0][i] + right * axes[1][i] + down * axes[2][i]));
    for (const part of [[[1, 0, 0], [-0.7, 0.6, 0], [-0.5, 0, 0], [-0.7, -0.6, 0]], [[-0.1, 0, 0], [-0.7, 0, -0.35], [-0.6, 0, 0]]]) {
      pen.globalAlpha = 0.55;
      pen.fillStyle = color;
      pen.beginPath();
      part.forEach((corner, i) => (i ? pen.lineTo(...point(...corner)) : pen.moveTo(...point(...corner))));
      pen.fill();
      pen.globalAlpha = 1;
      drawLine(pen, [...part, part[0]].map((corner) => point(...corner)), color, 1);
    }
    ["x", "y", "z"].forEach((name, i) => {
      const tip = point(...[0, 1, 2].map((k) => (k === i ? 1.35 : 0)));
      drawLine(pen, [[x, y], tip], style.ink(), 1.5);
      pen.fillStyle = style.ink();
      pen.fillText(name, tip[0] + 3, tip[1] + 4);
    });
  };

  // Round distances in metres that enclose both ends, with about four lines over the longer side.
  const lines = ([low, high], step) => Array.from({ length: Math.ceil(high / step) - Math.floor(low / step) + 1 }, (_, i) => (Math.floor(low / step) + i) * step);
  const drawGround = (pen, to, [easts, norths]) => {
    for (const east of easts) drawLine(pen, [to([east, norths[0], 0]), to([east, norths.at(-1), 0])], style.line(), 1);
    for (const north of norths) drawLine(pen, [to([easts[0], north, 0]), to([easts.at(-1), north, 0])], style.line(), 1);
    pen.fillStyle = style.ink();
    const label = (values, at, name, align, right, down) => {
      const spots = values.map((value) => to(at(value)));
      if (Math.hypot(spots.at(-1)[0] - spots[0][0], spots.at(-1)[1] - spots[0][1]) < 45) return; // otherwise the labels would overlap
      const [low, high] = [spots[0], spots.at(-1)];
      pen.textAlign = align;
      pen.fillText(text(values[0] / 1000), low[0] + right, low[1] + down);
      pen.fillText(`${text(values.at(-1) / 1000)} km ${name}`, high[0] + right, high[1] + down);
      pen.textAlign = "left";
    };
    label(easts, (east) => [east, norths[0], 0], "east", "right", 0, 16);
    label(norths, (north) => [easts.at(-1), north, 0], "north", "left", 8, 5);
  };

  const drawPanel = (pen, flight, [left, top, wide, high]) => {
    const size = wide < 450 ? 36 : 58; // half of the vehicle's length, px
    const spans = [0, 1].map((i) => { const held = flights.flatMap(({ path }) => path.map((each) => each[i])); return [Math.min(...held), Math.max(...held)]; });
    const step = ticks(0, Math.max(...spans.map(([a, b]) => b - a), 1), 5)[1];
    const grid = spans.map((span) => lines(span, step));
    const corners = [...flights.flatMap(({ path }) => path), ...grid[0].flatMap((east) => grid[1].map((north) => [east, north, 0]))].map(project);
    const [[x0, x1], [y0, y1]] = [0, 1].map((i) => [Math.min(...corners.map((p) => p[i])), Math.max(...corners.map((p) => p[i]))]);
    const scale = Math.min((wide - 3.2 * size) / (x1 - x0 || 1), (high - 2.4 * size) / (y1 - y0 || 1));
    const to = (each) => { const [x, y] = project(each); return [left + wide / 2 - 0.4 * size + scale * (x - (x0 + x1) / 2), top + high / 2 + 14 - scale * (y - (y0 + y1) / 2)]; };
    pen.save();
    pen.beginPath();
    pen.rect(left, top, wide, high);
    pen.clip();
    pen.font = `12px ${style.font}`;
    drawGround(pen, to, grid);
    for (const { path, color, name } of [...flights.filter((each) => each !== flight), flight]) {
      pen.globalAlpha = name === flight.name ? 1 : 0.3;
      drawLine(pen, path.map((each) => to(below(each))), color, 1, [2, 3]);
      drawLine(pen, path.map(to), color, 2);
    }
    pen.globalAlpha = 1;
    const at = sample(flight, moment);
    drawLine(pen, [to(place(at)), to(below(place(at)))], style.ink(), 1, [2, 3]);
    drawVehicle(pen, to(place(at)), at, flight.color, size);
    pen.fillStyle = style.ink();
    pen.font = `bold 13px ${style.font}`;
    pen.fillText(flight.name, left + 8, top + 18);
    pen.font = `12px ${style.font}`;
    const said = [`bank ${at.bank_deg.toFixed(1)} deg, altitude ${text(at.altitude_m, 6)} m`, `angle of attack ${at.angle_of_attack_deg.toFixed(2)}, sideslip ${at.sideslip_deg.toFixed(2)} deg`];
    said.forEach((line, i) => pen.fillText(line.replaceAll("-", "\u2212"), left + 8, top + 36 + 17 * i));
    pen.restore();
  };

  const draw = () => {
    if (host.hidden || !canvas.clientWidth) return;
    const ratio = window.devicePixelRatio || 1;
    [canvas.width, canvas.height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const beside = canvas.clientWidth > 700;
    const [wide, high] = [canvas.clientWidth / (beside ? flights.length : 1), canvas.clientHeight / (beside ? 1 : flights.length)];
    flights.forEach((flight, i) => drawPanel(pen, flight, [beside ? i * wide : 0, beside ? 0 : i * high, wide, high]));
    slider.value = moment;
    slider.setAttribute("aria-valuetext", `${moment.toFixed(1)} s`);
    said.textContent = `${moment.toFixed(1)} s of ${end.toFixed(1)}`;
  };

  const stop = () => { playing = 0; button.textContent = "Play"; };
  // If the user prefers reduced motion, the animation advances only twice per second.
  const step = (turnOf, before) => (now) => {
    if (turnOf !== playing) return;
    if (still.matches && now - before < 500) { requestAnimationFrame(step(turnOf, before)); return; }
    moment = Math.min(end, moment + ((now - before) / 1000) * (end / LASTS));
    draw();
    if (moment >= end) stop(); else requestAnimationFrame(step(turnOf, now));
  };
  button.addEventListener("click", () => {
    if (playing) { stop(); return; }
    if (moment >= end) moment = 0;
    playing = performance.now();
    button.textContent = "Pause";
    requestAnimationFrame(step(playing, playing));
  });
  slider.addEventListener("input", () => { stop(); moment = Number(slider.value); draw(); });
  const look = (right, up) => {
    view = { azimuth: view.azimuth + right, elevation: Math.min(90, Math.max(0, view.elevation + up)) };
    draw();
  };
  canvas.addEventListener("keydown", (event) => {
    const turned = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[event.key];
    if (!turned) return;
    event.preventDefault();
    look(...turned);
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => { if (event.buttons) look(event.movementX / 3, event.movementY / 3); });
  addEventListener("resize", draw);

  // `given`: history, name and colour of each flight; flights without samples or without a needed channel are omitted.
  const show = (given) => {
    stop();
    flights = given.filter(({ history }) => NEEDED.every((name) => history.channels[name])).map(({ history: { time, channels }, name, color }) => {
      const whole = time.map((_, k) => NEEDED.every((each) => channels[each][k] !== null && Number.isFinite(channels[each][k])));
      return { time, channels, name, color, last: whole.indexOf(false) < 0 ? whole.length - 1 : whole.indexOf(false) - 1 };
    }).filter(({ last }) => last > 0);
    host.hidden = !flights.length;
    if (!flights.length) return;
    const reach = (name) => { const held = flights.flatMap(({ channels, last }) => channels[name].slice(0, last + 1)); return [Math.min(...held), Math.max(...held)]; };
    const [[e0, e1], [n0, n1], [u0, u1]] = ["east_m", "north_m", "altitude_m"].map(reach);
    const size = Math.max(e1 - e0, n1 - n0, 1);
    stretch = Math.max(1, Math.min(1000, (0.1 * size) / (u1 - u0 || 1)));
    ground = u0 - (0.12 * size) / stretch;
    for (const flight of flights) flight.path = flight.time.slice(0, flight.last + 1).map((_, k) => place({ east_m: flight.channels.east_m[k], north_m: flight.channels.north_m[k], altitude_m: flight.channels.altitude_m[k] }));
    end = Math.max(...flights.map(({ time, last }) => time[last]));
    moment = Math.min(moment, end);
    [slider.max, slider.step] = [end, end / 600];
    words.textContent = `Horizontal distances are to scale, and altitude is stretched ${text(stretch, 2)} times; the dotted line is the shadow. The vehicle is enlarged and has its true attitude without wind; x, y, z are the body axes. Drag or press arrow keys to turn the view.`;
    draw();
  };
  return { show, draw, attitude };
};
