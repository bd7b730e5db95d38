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

function startPlayer(player) {
  const data = JSON.parse(player.querySelector("script").textContent);
  const canvas = player.querySelector("canvas");
  const [button, slider, speed] = player.querySelectorAll("button, input, select");
  const output = player.querySelector("output");
  const context = canvas.getContext("2d");
  const [left, top, right, bottom] = data.box;
  canvas.height = Math.round((canvas.width * Math.abs(bottom - top)) / Math.abs(right - left));
  context.scaleX = canvas.width / Math.abs(right - left);
  context.scaleY = canvas.height / Math.abs(bottom - top);
  context.toX = (x) => (canvas.width * (x - left)) / (right - left);
  context.toY = (y) => (canvas.height * (y - top)) / (bottom - top);
  const last = data.steps.length - 1;
  slider.max = last;
  for (const shape of data.shapes) {
    if (shape.active) shape.active = spread(shape.active, last + 1);
    if (shape.visible) shape.visible = spread(shape.visible, last + 1);
  }
  let timer = null;

  function draw() {
    const frame = Number(slider.value);
    context.clearRect(0, 0, canvas.width, canvas.height);
    data.shapes.forEach((shape) => drawShape(context, shape, frame));
    for (const mover of data.movers) {
      drawPath(context, data.shapes[mover], frame);
      drawShape(context, data.shapes[mover], frame);
    }
    const action = data.actions.length ? `, action ${data.actions[Math.max(frame - 1, 0)]}` : "";
    const score = data.scores[countUpTo(data.scored, frame) - 1] ?? 0;
    output.value = `step ${data.steps[frame]} of ${data.steps[last]}, score ${score}${action}`;
  }

  function stop() {
    cancelAnimationFrame(timer);
    timer = null;
    button.textContent = "Play";
  }

  function advance() {
    slider.value = Math.min(Number(slider.value) + Number(speed.value), last);
    draw();
    if (Number(slider.value) < last) timer = requestAnimationFrame(advance);
    else stop();
  }

  button.addEventListener("click", () => {
    if (timer !== null) return stop();
    if (Number(slider.value) === last) slider.value = 0;
    button.textContent = "Pause";
    timer = requestAnimationFrame(advance);
  });
  slider.addEventListener("input", draw);
  slider.value = last;
  draw();
}

document.querySelectorAll(".player").forEach(startPlayer);
