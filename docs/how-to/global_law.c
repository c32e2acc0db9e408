typedef struct { DW_model_T dw; } saved_state;      /* everything that model_step() changes: DW and, if present, B and X */

size_t abhv_law_state_size(void) { return sizeof(saved_state); }
int abhv_law_init(const abhv_settings *s, const abhv_reference *r, void *state) {
    model_initialize();
    ((saved_state *)state)->dw = model_DW;
    return 0;
}
int abhv_law_step(const abhv_measured *m, const abhv_reference *r, const double *k, const abhv_settings *s, double time,
                  double dt, void *state, abhv_command *c) {
    saved_state *saved = state;
    model_U.alpha = m->angle_of_attack;
    model_DW = saved->dw;                           /* 1 */
    model_step();                                   /* 2 */
    saved->dw = model_DW;                           /* 3 */
    c->elevator = model_Y.elevator;
    return 0;
}
