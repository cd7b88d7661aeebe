// The pictures of a painting in progress, one after another, with a slider and a play button.
const APART = 70; // milliseconds between two pictures
export default {
  template: `
    <div>
      <div class="stage"><img :src="frames[at]" :alt="'the painting, picture ' + (at + 1) + ' of ' + frames.length"></div>
      <div class="transport">
        <button class="button" type="button" @click="play">{{ timer ? "Pause" : "Play" }}</button>
        <input class="slider" type="range" min="0" :max="frames.length - 1" v-model.number="at"
          aria-label="Moment of the painting" :aria-valuetext="captions[at]" @input="pause"
          @keydown="pause">
        <output>{{ captions[at] }}</output>
      </div>
    </div>`,
  props: { frames: Array, captions: Array },
  data() { return { at: 0, timer: 0, loaded: this.frames.map((source) => Object.assign(new Image(), { src: source })) }; },
  mounted() { this.play(); },
  unmounted() { this.pause(); },
  methods: {
    play() {
      if (this.timer) return this.pause();
      if (this.at === this.frames.length - 1) this.at = 0;
      this.timer = setInterval(() => { if (++this.at >= this.frames.length - 1) this.pause(); }, APART);
    },
    pause() {
      clearInterval(this.timer);
      this.timer = 0;
    },
  },
};
