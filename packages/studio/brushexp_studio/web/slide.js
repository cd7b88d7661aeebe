// A slider with its name and value; it keeps its own value while it moves, and emits each value as the event "change".
export default {
  template: `
    <div class="slide"><span aria-hidden="true">{{ name }}</span><output>{{ shown }}</output>
      <input class="slider" type="range" :min="low" :max="high" :step="step" v-model.number="now"
        :aria-label="name" :aria-valuetext="shown" @input="$emit('change', now)">
    </div>`,
  props: { name: String, low: Number, high: Number, step: Number, value: Number, shown: String },
  emits: ["change"],  // hides the input's native event of the same name
  data() { return { now: this.value }; },
  watch: { value(value) { this.now = value; } },
};
