// A mask painted over a picture for the purpose "label". It is sent to the studio after every mark; the event "answer"
// carries the studio's reply.
const SIDE = 512; // pixels of the mask's longer side
export default {
  template: `
    <div class="masking">
      <div class="stage">
        <img :src="picture" alt="">
        <canvas ref="canvas" :width="width" :height="height" tabindex="0" role="img"
          :aria-label="label + ': arrow keys move the brush, space paints'"
          @pointerdown="begin" @pointermove="move" @pointerup="end" @pointercancel="end" @pointerleave="out"
          @keydown="key"></canvas>
        <span class="tip" v-show="tip" :style="place" aria-hidden="true"></span>
      </div>
      <div class="row tools" role="group" :aria-label="group">
        <button class="button" type="button" :aria-pressed="!erasing" @click="erasing = false">Brush</button>
        <button class="button" type="button" :aria-pressed="erasing" @click="erasing = true">Eraser</button>
        <label class="field">Size <input class="slider" type="range" min="2" max="25" v-model.number="size"></label>
        <button class="button" type="button" @click="clear">Clear</button>
      </div>
    </div>`,
  props: { picture: String, ratio: Number, address: String, before: String, label: String, group: String },
  data: () => ({ erasing: false, size: 9, tip: null, last: null }),
  computed: {
    width() { return Math.round(this.ratio >= 1 ? SIDE : SIDE * this.ratio); },
    height() { return Math.round(this.ratio >= 1 ? SIDE / this.ratio : SIDE); },
    radius() { return (this.size / 100) * Math.min(this.width, this.height); },
    place() {
      if (!this.tip) return {};
      const share = (2 * this.radius) / this.width;
      return { left: `${(100 * this.tip.x) / this.width}%`, top: `${(100 * this.tip.y) / this.height}%`, width: `${100 * share}%` };
    },
  },
  mounted() {
    this.brush = this.$refs.canvas.getContext("2d");
    if (!this.before) return;
    const image = new Image();
    image.onload = () => {
      this.brush.drawImage(image, 0, 0, this.width, this.height);
      const pixels = this.brush.getImageData(0, 0, this.width, this.height);
      for (let k = 0; k < pixels.data.length; k += 4) pixels.data[k + 3] = pixels.data[k]; // grey is opacity
      this.brush.putImageData(pixels, 0, 0);
    };
    image.src = this.before;
  },
  methods: {
    at(event) {
      const box = this.$refs.canvas.getBoundingClientRect();
      return { x: ((event.clientX - box.left) * this.width) / box.width, y: ((event.clientY - box.top) * this.height) / box.height };
    },
    begin(event) {
      if (event.button) return;
      this.$refs.canvas.setPointerCapture(event.pointerId);
      this.last = this.tip = this.at(event);
      this.mark(this.last);
    },
    move(event) {
      this.tip = this.at(event);
      if (this.last) {
        this.mark(this.tip);
        this.last = this.tip;
      }
    },
    end() {
      if (this.last) this.send();
      this.last = null;
    },
    out() { if (!this.last) this.tip = null; },
    key(event) {
      const [x, y] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [0, 0];
      if (!x && !y && event.key !== " ") return;
      event.preventDefault();
      const from = this.tip ?? { x: this.width / 2, y: this.height / 2 };
      const inside = (value, most) => Math.min(most, Math.max(0, value));
      this.tip = { x: inside(from.x + x * this.radius, this.width), y: inside(from.y + y * this.radius, this.height) };
      if (event.key === " ") {
        this.mark(this.tip);
        this.send();
      }
    },
    mark(to) {
      const from = this.last ?? to;
      this.brush.globalCompositeOperation = this.erasing ? "destination-out" : "source-over";
      this.brush.strokeStyle = "#fff";
      this.brush.lineCap = this.brush.lineJoin = "round";
      this.brush.lineWidth = 2 * this.radius;
      this.brush.beginPath();
      this.brush.moveTo(from.x, from.y);
      this.brush.lineTo(to.x + 1e-3, to.y);
      this.brush.stroke();
    },
    clear() {
      this.brush.clearRect(0, 0, this.width, this.height);
      this.send();
    },
    send() {
      const black = Object.assign(document.createElement("canvas"), { width: this.width, height: this.height });
      const under = black.getContext("2d");
      under.fillRect(0, 0, this.width, this.height);
      under.drawImage(this.$refs.canvas, 0, 0);
      black.toBlob(async (file) => {
        const answer = await fetch(this.address, { method: "POST", body: file });
        this.$emit("answer", await answer.json());
      });
    },
  },
};
