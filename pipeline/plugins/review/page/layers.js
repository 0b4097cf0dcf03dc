// Layers of frames: linear half floats and display values, whose pixels a page in a folder may read; and pictures of them
// by WebGL: exposure, gamma, one channel, and false colour.

/** One layer of a frame. `bits` are half floats, or display steps, as red, green, blue and alpha of each pixel. */
class Layer {
  constructor(about, bytes) {
    Object.assign(this, about);
    const count = this.width * this.height, series = summed(bytes, count, Uint16Array);
    this.bits = new Uint16Array(4 * count);
    for (let channel = 0; channel < 4; channel++) {
      const values = this.channels === 1 ? series[0] : series[channel]; // grey is red, green and blue
      for (let i = 0; values && i < count; i++) this.bits[4 * i + channel] = values[i];
    }
  }

  /** The values of a pixel, as many as the layer has channels. */
  at(x, y) {
    const from = 4 * (y * this.width + x), value = this.kind === "display" ? (bits) => bits : fromHalf;
    return Array.from(this.bits.subarray(from, from + this.channels), value);
  }
}

/** The number that 16 bits are as a half float. */
function fromHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction);
}

const VERTEX_SHADER = `#version 300 es
void main() { gl_Position = vec4(vec2[3](vec2(-1, -1), vec2(3, -1), vec2(-1, 3))[gl_VertexID], 0, 1); }`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D layer;
uniform mediump sampler3D view;
uniform vec2 range;
uniform float gain, power, toe, white, side;
uniform int channel, kind;
uniform bool clipping, hasView;
uniform float height;
out vec4 shown;
vec3 toLinear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 toDisplay(vec3 c) { return mix(c * 12.92, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
void main() {
  vec3 c = texelFetch(layer, ivec2(gl_FragCoord.x, height - gl_FragCoord.y), 0).rgb;
  bvec3 isNone = isnan(c);
  c = (c - range.x) / (range.y - range.x);
  if (kind == 0) c = toLinear(c);
  c *= gain;
  if (hasView) {
    vec3 place = log2(1.0 + clamp(c, 0.0, white) / toe) / log2(1.0 + white / toe);
    c = toLinear(texture(view, (place.bgr * (side - 1.0) + 0.5) / side).rgb);
  }
  if (channel == 4) c = vec3(dot(c, vec3(0.2126, 0.7152, 0.0722)));
  else if (channel > 0) c = vec3(channel == 1 ? c.r : channel == 2 ? c.g : c.b);
  if (kind < 2) c = toDisplay(c);
  vec3 seen = pow(clamp(c, 0.0, 1.0), vec3(power));
  if (clipping && any(isNone)) seen = vec3(1, 0, 1);
  else if (clipping && max(c.r, max(c.g, c.b)) > 0.995) seen = vec3(1, 0.16, 0.1);
  else if (clipping && max(c.r, max(c.g, c.b)) < 0.002) seen = vec3(0.1, 0.35, 1);
  shown = vec4(seen, 1);
}`;

const KINDS = { display: 0, light: 1, data: 2 };

/** Draws layers into canvases of their size. */
class Grader {
  constructor() {
    this.settings = { exposure: 0, gamma: 1, channel: "rgb", clipping: false };
    this.canvas = make("canvas");
    this.gl = this.canvas.getContext("webgl2", { antialias: false, depth: false, preserveDrawingBuffer: true });
    this.#prepare();
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault()); // so that it comes back
    this.canvas.addEventListener("webglcontextrestored", () => this.#prepare());
    this.drawn = new WeakMap();  // layer -> {state, canvas}
  }

  /** The layer as a canvas that shows it by these settings, through the table `view` if there is one; null without WebGL. */
  graded(layer, view = null) {
    if (!this.gl || this.gl.isContextLost()) return null;
    const state = JSON.stringify(this.settings), last = this.drawn.get(layer);
    if (last?.state === state) return last.canvas;
    const { width, height } = layer, canvas = last?.canvas ?? make("canvas");
    Object.assign(canvas, { width, height });
    canvas.getContext("2d", { alpha: false }).drawImage(this.#draw(layer, view), 0, 0);
    this.drawn.set(layer, { state, canvas });
    return canvas;
  }

  #prepare() {
    if (!this.gl) return;
    const { gl } = this, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    this.place = (name) => gl.getUniformLocation(program, name);
    gl.uniform1i(this.place("view"), 1);
    for (const [unit, target, filter] of [[gl.TEXTURE1, gl.TEXTURE_3D, gl.LINEAR], [gl.TEXTURE0, gl.TEXTURE_2D, gl.NEAREST]]) {
      gl.activeTexture(unit);
      gl.bindTexture(target, gl.createTexture());
      for (const name of ["MIN", "MAG"]) gl.texParameteri(target, gl[`TEXTURE_${name}_FILTER`], filter);
      for (const axis of ["S", "T", "R"]) gl.texParameteri(target, gl[`TEXTURE_WRAP_${axis}`], gl.CLAMP_TO_EDGE);
    }
    this.#loadTable(1, new Uint8Array(4));
    this.view = null;
  }

  #loadTable(side, bytes) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE1);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, side, side, side, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.activeTexture(gl.TEXTURE0);
  }

  /** Use the table of a view, which shows light as display values. */
  #useView(view) {
    const { gl, place } = this;
    gl.uniform1i(place("hasView"), view !== null);
    if (!view || view === this.view) return;
    this.view = view;
    const { side, toe, white, bits } = view;
    this.#loadTable(side, Uint8Array.from(bits));
    for (const [name, value] of Object.entries({ side, toe, white })) gl.uniform1f(place(name), value);
  }

  #draw(layer, view) {
    const { gl, place, settings } = this, { width, height, low, high, kind } = layer;
    Object.assign(this.canvas, { width, height });
    gl.viewport(0, 0, width, height);
    this.#useView(view);
    const isDisplay = kind === "display";
    const texels = isDisplay ? Float32Array.from(layer.bits) : layer.bits;
    gl.texImage2D(gl.TEXTURE_2D, 0, isDisplay ? gl.RGBA32F : gl.RGBA16F, width, height, 0, gl.RGBA, isDisplay ? gl.FLOAT : gl.HALF_FLOAT, texels);
    gl.uniform2f(place("range"), low, high);
    const floats = { gain: 2 ** settings.exposure, power: 1 / settings.gamma, height };
    for (const [name, value] of Object.entries(floats)) gl.uniform1f(place(name), value);
    const whole = { channel: Object.keys(CHANNEL_NAMES).indexOf(settings.channel), kind: KINDS[kind], clipping: settings.clipping };
    for (const [name, value] of Object.entries(whole)) gl.uniform1i(place(name), value);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    return this.canvas;
  }
}
