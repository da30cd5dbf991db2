// Draws torque or position over time as SVG in place of the still figure: dragging moves in time, the wheel or two keys come closer.
{
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const scaled = ({ step, values }) => Float64Array.from(new Int16Array(bytes(values)), (value) => (value < -32767 ? NaN : value * step));
  const [LEFT, RIGHT, TOP, MIDDLE, BELOW, BOTTOM, HEIGHT] = [64, 10, 8, 196, 214, 296, 334];
  const KINDS = ["measured", "given", "corrected"];

  // Round numbers between two ends, at most `most` of them.
  const ticks = (low, high, most) => {
    const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((digit) => digit * power).find((size) => size >= rough * 0.999);
    const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
    if (last <= first && most < 40) return ticks(low, high, 2 * most);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return Array.from({ length: last - first + 1 }, (_, k) => ({
      at: (first + k) * step, text: Math.abs(step) >= 1e5 || step < 1e-4
        ? ((first + k) * step).toPrecision(3) : ((first + k) * step).toFixed(digits),
    }));
  };
  // Index of the first time that is not before `time`.
  const index = (t, time) => {
    let [low, high] = [0, t.length];
    while (low < high) {
      const half = (low + high) >> 1;
      if (t[half] < time) low = half + 1;
      else high = half;
    }
    return low;
  };
  // A path through the samples; where many share a pixel, through the least and the largest of them.
  const path = (t, y, first, last, x, level, starts) => {
    let out = "", pixel = null, kept = [], move = true;
    const flush = () => {
      const ends = kept.length > 4 ? [kept[0], ...extremes(kept, y), kept.at(-1)] : kept;
      for (const k of ends) {
        out += `${move ? "M" : "L"}${x(t[k]).toFixed(1)} ${level(y[k]).toFixed(1)}`;
        move = false;
      }
      kept = [];
    };
    for (let k = first; k < last; k += 1) {
      const here = Math.floor(x(t[k]));
      const gap = starts.has(k) || Number.isNaN(y[k]);
      if (gap || here !== pixel) flush();
      if (gap) move = true;
      pixel = here;
      if (!Number.isNaN(y[k])) kept.push(k);
    }
    flush();
    return out;
  };
  const escaped = (text) => text.replace(/[<>&"]/g, (letter) => `&#${letter.charCodeAt(0)};`);
  const extremes = (kept, y) => {
    const [least, most] = [kept.reduce((a, b) => (y[b] < y[a] ? b : a)), kept.reduce((a, b) => (y[b] > y[a] ? b : a))];
    return [Math.min(least, most), Math.max(least, most)];
  };
  const range = (series, first, last) => {
    let [low, high] = [Infinity, -Infinity];
    for (const y of series) for (let k = first; k < last; k += 1) {
      if (y[k] < low) low = y[k];
      if (y[k] > high) high = y[k];
    }
    return low < high ? [low - 0.05 * (high - low), high + 0.05 * (high - low)] : [(low || 0) - 1, (low || 0) + 1];
  };

  const show = (place, given) => {
    const t = new Float32Array(bytes(given.t)), measured = scaled(given.measured);
    const residuals = [scaled(given.before), scaled(given.after)];
    const torques = [measured, ...residuals.map((residual) => measured.map((value, k) => value - residual[k]))];
    const steps = Array.from(t.slice(1), (time, k) => time - t[k]).sort((a, b) => a - b);
    const starts = new Set(given.starts), whole = [t[0], t[t.length - 1]];
    const least = Math.min(20 * (steps[steps.length >> 1] || 1), whole[1] - whole[0]);
    const stands = given.touched ?? [];
    let view = [...given.view];
    place.innerHTML = `<p class="tools"><span class="keys">${KINDS.map((kind) => `<span><i class="${kind}"></i>${kind === "measured"
      ? kind : `${kind} model`}</span>`).join(" ")}${stands.length ? ' <span><i class="stance"></i>contact within the filter’s reach: not judged</span>' : ""}</span><span><button aria-label="earlier">◀</button><button
      aria-label="later">▶</button><button aria-label="closer">+</button><button aria-label="further away">−</button><button>whole
      recording</button></span></p><div class="drawing" tabindex="0"></div><p class="soft reading"></p>`;
    const drawing = place.querySelector(".drawing"), reading = place.querySelector(".reading");
    const hint = "Drag to move in time; the wheel after a click, or + and −, come closer; a double click goes back.";
    reading.textContent = hint;

    const scale = () => Math.max(drawing.clientWidth, 300) - LEFT - RIGHT;
    const axis = (series, first, last, from, to, unit, floor) => {
      const [low, high] = range(series, first, last);
      const level = (value) => to - ((value - low) / (high - low)) * (to - from);
      const marks = ticks(low, high, Math.max(2, (to - from) / 27)).map(({ at, text }) =>
        `<path class="tick" d="M${LEFT - 4} ${level(at)}h4"/><text x="${LEFT - 7}" y="${level(at) + 4}" text-anchor="end">${text}</text>`);
      const ends = [floor, -floor].map((value) => Math.min(Math.max(level(value), from), to));
      const band = floor ? `<rect class="band" x="${LEFT}" y="${ends[0]}" width="${scale()}" height="${ends[1] - ends[0]}"/>` : "";
      const label = `<text transform="translate(13 ${(from + to) / 2}) rotate(-90)" text-anchor="middle">${escaped(unit)}</text>`;
      return { level, drawn: `${band}<path class="tick" d="M${LEFT} ${from}V${to}"/>${marks.join("")}${label}` };
    };
    const draw = () => {
      if (!drawing.clientWidth) return;
      const wide = scale(), x = (time) => LEFT + ((time - view[0]) / (view[1] - view[0])) * wide;
      const first = Math.max(index(t, view[0]) - 1, 0), last = Math.min(index(t, view[1]) + 1, t.length);
      const above = axis(torques, first, last, TOP, MIDDLE, given.torque, 0);
      const below = axis(residuals, first, last, BELOW, BOTTOM, given.residual, given.floor);
      const curve = (kind, y, level) => `<path class="curve ${kind}" d="${path(t, y, first, last, x, level, starts)}"/>`;
      const times = ticks(...view, Math.max(2, wide / 80)).map(({ at, text }) =>
        `<path class="tick" d="M${x(at)} ${BOTTOM}v4"/><text x="${x(at)}" y="${BOTTOM + 17}" text-anchor="middle">${text}</text>`);
      const stances = stands.filter(([from, to]) => to > view[0] && from < view[1]).map(([from, to]) =>
        `<rect class="stance" x="${x(from).toFixed(1)}" y="${TOP}" width="${(x(to) - x(from)).toFixed(1)}" height="${BOTTOM - TOP}"/>`);
      const inside = `clip-${place.id}`;
      drawing.innerHTML = `<svg viewBox="0 0 ${wide + LEFT + RIGHT} ${HEIGHT}" aria-hidden="true">
        <clipPath id="${inside}"><rect x="${LEFT}" y="0" width="${wide}" height="${HEIGHT}"/></clipPath>
        ${above.drawn}${below.drawn}<path class="tick" d="M${LEFT} ${BOTTOM}h${wide}"/>${times.join("")}
        <text x="${LEFT + wide / 2}" y="${HEIGHT - 3}" text-anchor="middle">time [s]</text><g clip-path="url(#${inside})">
        ${stances.join("")}${torques.map((y, k) => curve(KINDS[k], y, above.level)).join("")}
        ${residuals.map((y, k) => curve(KINDS[k + 1], y, below.level)).join("")}</g></svg>`;
    };
    const look = (from, to) => {
      const span = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
      const start = Math.min(Math.max((from + to - span) / 2, whole[0]), whole[1] - span);
      view = [start, start + span];
      draw();
    };
    const move = (part) => look(view[0] + part * (view[1] - view[0]), view[1] + part * (view[1] - view[0]));
    const closer = (factor, part = 0.5) => {
      const at = view[0] + part * (view[1] - view[0]);
      look(at - (at - view[0]) * factor, at + (view[1] - at) * factor);
    };
    const part = (event) => Math.min(Math.max((event.clientX - drawing.getBoundingClientRect().left - LEFT) / scale(), 0), 1);

    const actions = [() => move(-0.5), () => move(0.5), () => closer(0.5), () => closer(2), () => look(...whole)];
    place.querySelectorAll("button").forEach((button, k) => button.addEventListener("click", actions[k]));
    const down = new Map();
    drawing.addEventListener("pointerdown", (event) => {
      down.set(event.pointerId, event.clientX);
      drawing.setPointerCapture(event.pointerId);
    });
    drawing.addEventListener("pointermove", (event) => {
      if (!down.has(event.pointerId)) {
        const time = view[0] + part(event) * (view[1] - view[0]), k = Math.min(index(t, time), t.length - 1);
        const values = torques.map((y, kind) => `${KINDS[kind]} ${Number.isNaN(y[k]) ? "–" : y[k].toPrecision(4)}`).join(", ");
        reading.textContent = `${t[k].toFixed(3)} s: ${values} ${given.unit}`;
        return;
      }
      const others = [...down].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const last = down.get(event.pointerId);
      down.set(event.pointerId, event.clientX);
      if (others.length) closer(Math.max(Math.abs(last - others[0]), 8) / Math.max(Math.abs(event.clientX - others[0]), 8));
      else move((last - event.clientX) / scale());
    });
    for (const name of ["pointerup", "pointercancel"]) drawing.addEventListener(name, (event) => down.delete(event.pointerId));
    drawing.addEventListener("pointerleave", () => (reading.textContent = hint));
    drawing.addEventListener("dblclick", () => look(...given.view));
    drawing.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== drawing) return; // the page scrolls until the figure is clicked
      event.preventDefault();
      closer(Math.exp(event.deltaY / 400), part(event));
    }, { passive: false });
    drawing.addEventListener("keydown", (event) => {
      const keys = { ArrowLeft: 0, ArrowRight: 1, "+": 2, "-": 3, Home: 4 };
      if (!(event.key in keys)) return;
      event.preventDefault();
      actions[keys[event.key]]();
    });
    new ResizeObserver(draw).observe(drawing);
    draw();
  };
  for (const given of JSON.parse(document.getElementById("time-curves").textContent)) {
    show(document.getElementById(given.id), given);
  }
}
