#include "abhv_law.h"
#include "model.h"
typedef struct { RT_MODEL_model_T m; DW_model_T dw; ExtU_model_T u; ExtY_model_T y; } all;

size_t abhv_law_state_size(void) { return sizeof(all); }
static RT_MODEL_model_T *wire(all *a) { a->m.dwork = &a->dw; a->m.inputs = &a->u; a->m.outputs = &a->y; return &a->m; }
int abhv_law_init(const abhv_settings *s, const abhv_reference *r, void *state) { model_initialize(wire(state)); return 0; }
int abhv_law_step(const abhv_measured *m, const abhv_reference *r, const double *k, const abhv_settings *s, double time,
                  double dt, void *state, abhv_command *c) {
    all *a = state;
    a->u.alpha = m->angle_of_attack;
    a->u.alpha_ref = r->angle_of_attack;
    model_step(&a->m);
    c->elevator = a->y.elevator; /* and the other outputs */
    return 0;
}
