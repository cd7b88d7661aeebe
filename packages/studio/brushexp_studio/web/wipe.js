// Two pictures under a divider that moves with the pointer, or with the arrow keys.
export default {
  template: `
    <div class="stage wipe" :style="{ '--split': split + '%' }" @pointerdown="begin" @pointermove="follow">
      <img :src="left" :alt="leftName" draggable="false">
      <img :src="right" :alt="rightName" draggable="false">
      <span class="wipe-label" aria-hidden="true">{{ leftName }}</span>
      <span class="wipe-label" aria-hidden="true">{{ rightName }}</span>
      <input type="range" min="0" max="100" step="any" v-model.number="split" ref="input"
        :aria-label="'Divider between ' + leftName + ' and ' + rightName"
        :aria-valuetext="Math.round(split) + ' % from the left'">
      <span class="wipe-handle" aria-hidden="true"></span>
    </div>`,
  props: { left: String, right: String, leftName: String, rightName: String },
  data: () => ({ split: 50 }),
  methods: {
    begin(event) {
      if (event.button) return;
      event.preventDefault();
      event.currentTarget.setPointerCapture(event.pointerId);
      this.$refs.input.focus({ preventScroll: true, focusVisible: false });
      this.follow(event);
    },
    follow(event) {
      const stage = event.currentTarget;
      if (!stage.hasPointerCapture(event.pointerId)) return;
      const box = stage.getBoundingClientRect();
      this.split = Math.min(100, Math.max(0, (100 * (event.clientX - box.left)) / box.width));
    },
  },
};
