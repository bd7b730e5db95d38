// Draws each .player from the JSON in it.
"use strict";

const at = (values, frame) => values[values.length > 1 ? frame : 0];
const countUpTo = (frames, frame) => frames.filter((f) => f <= frame).length;
const colourOf = (shape, frame) => (shape.active?.[frame] ? shape.activeColour : shape.colour);

// Flags come as the frames at which they change, beginning from false.
function spread(changes, frames) {
  const places = new Set(changes);
  let on = false;
  return Array.from({ length: frames }, (_, frame) => (on = places.has(frame) ? !on : on));
}

function drawPath(context, shape, frame) {
  context.lineWidth = 1.5;
  for (let i = 1; i <= frame; i++) {
    context.strokeStyle = colourOf(shape, i);
    context.beginPath();
    context.moveTo(context.toX(shape.x[i - 1]), context.toY(shape.y[i - 1]));
    context.lineTo(context.toX(shape.x[i]), context.toY(shape.y[i]));
    context.stroke();
  }
}

function drawShape(context, shape, frame) {
  if (shape.visible?.[frame] === false) return;
  const x = context.toX(at(shape.x, frame));
  const y = context.toY(at(shape.y, frame));
  const half = shape.halfWidth * context.scaleX;
  context.fillStyle = colourOf(shape, frame);
  context.beginPath();
  if (shape.halfHeight === undefined) {
    context.arc(x, y, half, 0, 2 * Math.PI);
  } else {
    const halfHeight = shape.halfHeight * context.scaleY;
    context.rect(x - half, y - halfHeight, 2 * half, 2 * halfHeight);
  }
  context.fill();
  if (shape.heading !== undefined) {
    const angle = at(shape.heading, frame);
    context.strokeStyle = "#000";
    context.lineWidth = 3;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + 1.5 * half * Math.cos(angle), y + 1.5 * half * Math.sin(angle));
    context.stroke();
  }
}

// One of the moving pictures: `show` has it play other data, `draw` draws what is at a timestep.
function makeScreen(figure) {
  const canvas = figure.querySelector("canvas");
  const output = figure.querySelector("output");
  const context = canvas.getContext("2d");
  let data = null;

  function show(next) {
    data = next;
    const [left, top, right, bottom] = data.box;
    canvas.height = Math.round((canvas.width * Math.abs(bottom - top)) / Math.abs(right - left));
    context.scaleX = canvas.width / Math.abs(right - left);
    context.scaleY = canvas.height / Math.abs(bottom - top);
    context.toX = (x) => (canvas.width * (x - left)) / (right - left);
    context.toY = (y) => (canvas.height * (y - top)) / (bottom - top);
  }

  function draw(step) {
    const frame = countUpTo(data.steps, step) - 1;
    context.clearRect(0, 0, canvas.width, canvas.height);
    data.shapes.forEach((shape) => drawShape(context, shape, frame));
    for (const mover of data.movers) {
      drawPath(context, data.shapes[mover], frame);
      drawShape(context, data.shapes[mover], frame);
    }
    const action = data.actions.length ? `, action ${data.actions[Math.max(frame - 1, 0)]}` : "";
    const score = data.scores[countUpTo(data.scored, frame) - 1] ?? 0;
    output.value = `step ${data.steps[frame]} of ${data.steps.at(-1)}, score ${score}${action}`;
  }

  return { show, draw };
}

function read(script) {
  const both = JSON.parse(script.textContent);
  for (const data of both) {
    for (const shape of data.shapes) {
      if (shape.active) shape.active = spread(shape.active, data.steps.length);
      if (shape.visible) shape.visible = spread(shape.visible, data.steps.length);
    }
  }
  return both;
}

function startPlayer(player) {
  const scripts = player.querySelectorAll("script");
  const screens = Array.from(player.querySelectorAll(".screen"), makeScreen);
  const [rollout, speed] = [player.querySelector(".rollout"), player.querySelector(".speed")];
  const [button, slider] = player.querySelectorAll("button, input");
  let timer = null;
  let stride = 1; // timesteps from frame to frame

  const draw = () => screens.forEach((screen) => screen.draw(Number(slider.value)));

  function stop() {
    cancelAnimationFrame(timer);
    timer = null;
    button.textContent = "Play";
  }

  function advance() {
    slider.value = Math.min(Number(slider.value) + Number(speed.value) * stride, Number(slider.max));
    draw();
    if (Number(slider.value) < Number(slider.max)) timer = requestAnimationFrame(advance);
    else stop();
  }

  function choose() {
    stop();
    const both = read(scripts[rollout.value]);
    screens.forEach((screen, place) => screen.show(both[place]));
    slider.max = Math.max(...both.map((data) => data.steps.at(-1)));
    slider.value = slider.max;
    stride = Math.ceil(slider.max / Math.max(1, ...both.map((data) => data.steps.length - 1)));
    draw();
  }

  button.addEventListener("click", () => {
    if (timer !== null) return stop();
    if (slider.value === slider.max) slider.value = 0;
    button.textContent = "Pause";
    timer = requestAnimationFrame(advance);
  });
  slider.addEventListener("input", draw);
  rollout.addEventListener("change", choose);
  choose();
}

document.querySelectorAll(".player").forEach(startPlayer);
