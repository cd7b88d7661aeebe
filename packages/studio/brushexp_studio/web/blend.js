// A slider for the opacity of a painting over its photograph; the link saves the result.
export default {
  template: `
    <div>
      <div class="stage">
        <img :src="photograph" alt="the photograph">
        <img :src="painting" alt="the painting, over it" :style="{ opacity: share / 100 }">
      </div>
      <div class="transport">
        <span class="hint" aria-hidden="true">Photograph</span>
        <input class="slider" type="range" min="0" max="100" v-model.number="share"
          aria-label="From photograph to painting" :aria-valuetext="share + ' % painting'">
        <span class="hint" aria-hidden="true">Painting</span>
        <output>{{ share }} %</output>
        <a class="button" :href="saved + share + '.png'" download>Download as seen</a>
      </div>
    </div>`,
  props: { photograph: String, painting: String, saved: String },
  data: () => ({ share: 60 }),
};
