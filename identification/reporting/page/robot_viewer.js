// Draws the solids of a robot on a canvas, far ones first; dragging turns them, the wheel or two keys come closer, and a
// slider shows postures of the recording.
{
  const place = document.getElementById("robot-scene");
  const scene = JSON.parse(document.getElementById("robot-figure").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const canvas = document.createElement("canvas");
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  place.append(canvas, tip);

  // Every face with its corners in a cube from -1 to 1, its colour, its body, and the words of its solid. A long face is cut, as
  // only small ones have one depth.
  const faces = [];
  const longest = 0.1;
  const add = (corners, colour, solid) => {
    const lengths = corners.map((a, k) => Math.hypot(...a.map((value, axis) => value - corners[(k + 1) % 3][axis])));
    const k = lengths.indexOf(Math.max(...lengths));
    if (!(lengths[k] > longest)) return faces.push({ corners, at: corners, colour, text: solid.text, body: solid.body });
    const [a, b, c] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
    const middle = a.map((value, axis) => (value + b[axis]) / 2);
    add([a, middle, c], colour, solid);
    add([middle, b, c], colour, solid);
  };
  for (const solid of scene.solids) {
    const points = new Float32Array(bytes(solid.points).buffer);
    const corners = new Uint16Array(bytes(solid.faces).buffer);
    const colours = bytes(solid.colours);
    const at = (k) => [0, 1, 2].map((axis) => (points[3 * k + axis] - scene.middle[axis]) / scene.half);
    for (let f = 0; f < corners.length; f += 3) {
      const colour = `rgb(${colours[f]},${colours[f + 1]},${colours[f + 2]})`;
      add([at(corners[f]), at(corners[f + 1]), at(corners[f + 2])], colour, solid);
    }
  }
  const labels = scene.labels.map((label) => {
    const at = label.at.map((value, axis) => (value - scene.middle[axis]) / scene.half);
    return { text: label.text, body: label.body, corner: at, at };
  });

  const [ex, ey, ez] = scene.eye;
  const start = { turn: Math.atan2(ey, ex), height: Math.atan2(ez, Math.hypot(ex, ey)), distance: 4.6 };
  const camera = { ...start };
  let drawn = [];

  const draw = () => {
    const ratio = window.devicePixelRatio || 1;
    const width = place.clientWidth, height = place.clientHeight;
    if (!width || !height) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const ct = Math.cos(camera.turn), st = Math.sin(camera.turn);
    const ch = Math.cos(camera.height), sh = Math.sin(camera.height);
    const scale = 2 * Math.min(width, height);
    const project = ([x, y, z]) => {
      const right = -st * x + ct * y;
      const up = -sh * (ct * x + st * y) + ch * z;
      const depth = camera.distance - ch * (ct * x + st * y) - sh * z;
      const near = Math.max(depth, 0.05);
      return [width / 2 + (scale * right) / near, height / 2 - (scale * up) / near, depth];
    };
    drawn = faces.map((face) => {
      const corners = face.at.map(project);
      return { face, corners, depth: corners[0][2] + corners[1][2] + corners[2][2] };
    });
    drawn.sort((one, other) => other.depth - one.depth);
    pen.lineWidth = 0.6;
    pen.lineJoin = "round";
    for (const { face, corners } of drawn) {
      pen.beginPath();
      for (const [x, y] of corners) pen.lineTo(x, y);
      pen.closePath();
      // The line in the colour of the face closes the seam to its neighbour.
      pen.fillStyle = pen.strokeStyle = face.colour;
      pen.fill();
      pen.stroke();
    }
    pen.fillStyle = pen.strokeStyle = getComputedStyle(document.body).color;
    pen.lineWidth = 1;
    pen.font = "12px system-ui, sans-serif";
    const taken = [];
    labels.forEach((label, k) => {
      const [x, y] = project(label.at), long = pen.measureText(label.text).width + 50;
      let side = k % 2 ? 1 : -1;
      if (x + long * side < 0 || x + long * side > width) side = -side;
      let level = y - 26;
      while (taken.some(([tx, ty, ts]) => ts === side && Math.abs(tx - x) < long && Math.abs(ty - level) < 14)) level -= 14;
      level = Math.max(level, 12);
      taken.push([x, level, side]);
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + 44 * side, level);
      pen.stroke();
      pen.textAlign = side > 0 ? "left" : "right";
      pen.fillText(label.text, x + 48 * side, level);
    });
  };

  const inside = (corners, x, y) => {
    const sides = corners.map(([ax, ay], k) => {
      const [bx, by] = corners[(k + 1) % 3];
      return (bx - ax) * (y - ay) - (by - ay) * (x - ax);
    });
    return sides.every((side) => side >= 0) || sides.every((side) => side <= 0);
  };
  const point = (x, y) => {
    let text = "";
    for (let k = drawn.length - 1; k >= 0; k -= 1) {
      if (inside(drawn[k].corners, x, y)) {
        text = drawn[k].face.text;
        break;
      }
    }
    tip.hidden = !text;
    tip.textContent = text;
    tip.style.left = `${Math.min(x + 12, place.clientWidth - tip.offsetWidth)}px`;
    tip.style.top = `${y + 12}px`;
  };
  const turn = (right, up) => {
    camera.turn -= right;
    camera.height = Math.min(Math.max(camera.height + up, -1.5), 1.5);
    draw();
  };
  const closer = (factor) => {
    camera.distance = Math.min(Math.max(camera.distance * factor, 1.8), 15);
    draw();
  };

  const { moves } = scene;
  if (moves) {
    const numbers = new Float32Array(bytes(moves.places).buffer);
    const pose = (frame) => {
      const moved = (body, [x, y, z]) => {
        const m = numbers.subarray(12 * (frame * moves.bodies + body));
        return [0, 1, 2].map((axis) => m[3 * axis] * x + m[3 * axis + 1] * y + m[3 * axis + 2] * z + m[9 + axis]);
      };
      for (const face of faces) face.at = face.corners.map((corner) => moved(face.body, corner));
      for (const label of labels) label.at = moved(label.body, label.corner);
    };
    const label = document.createElement("label"), slider = document.createElement("input");
    const time = document.createElement("output");
    label.className = "posture";
    Object.assign(slider, { type: "range", min: 0, max: moves.times.length - 1, step: 1, value: moves.start });
    const say = () => (time.textContent = `${moves.times[Number(slider.value)].toFixed(1)} s`);
    slider.addEventListener("input", () => {
      pose(Number(slider.value));
      say();
      draw();
    });
    say();
    label.append("Posture at", slider, time);
    place.after(label);
  }

  let last = null;
  canvas.tabIndex = 0;
  canvas.addEventListener("pointerdown", (event) => {
    last = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (last === null) return point(event.offsetX, event.offsetY);
    tip.hidden = true;
    turn((event.clientX - last[0]) / 120, (event.clientY - last[1]) / 120);
    last = [event.clientX, event.clientY];
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => (last = null));
  canvas.addEventListener("pointerleave", () => (tip.hidden = true));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;  // the page scrolls until the robot is clicked
    event.preventDefault();
    closer(Math.exp(event.deltaY / 600));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    Object.assign(camera, start);
    draw();
  });
  canvas.addEventListener("keydown", (event) => {
    const moves = {
      ArrowLeft: () => turn(0.1, 0), ArrowRight: () => turn(-0.1, 0), ArrowUp: () => turn(0, 0.1),
      ArrowDown: () => turn(0, -0.1), "+": () => closer(0.9), "-": () => closer(1.1),
    };
    if (!(event.key in moves)) return;
    event.preventDefault();
    moves[event.key]();
  });
  new ResizeObserver(draw).observe(place);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  draw();
}
