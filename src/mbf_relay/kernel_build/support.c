/* What the wrappers of all kernels share: arguments out of Python objects, errors into exceptions, and the few functions
 * of numba's runtime that compiled kernels call. All of it stays inside of the extension module. */
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define INTERNAL __attribute__((visibility("hidden")))

/* --- the processor --------------------------------------------------------------------------------------------- */

static bool is_wide = false;

/* Whether this processor, and the system on it, can what the wide kernels are made for, and nobody wants the others. */
static bool can_wide(void) {
#ifdef __x86_64__
    const char *wanted = getenv("MBF_RELAY_KERNELS");
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && (wanted == NULL || strcmp(wanted, "plain") != 0);
#else
    return false;
#endif
}

/* --- arguments ------------------------------------------------------------------------------------------------- */

static bool count_is(const char *kernel, Py_ssize_t count, Py_ssize_t wanted) {
    if (count == wanted) return true;
    PyErr_Format(PyExc_TypeError, "%s takes %zd arguments, not %zd", kernel, wanted, count);
    return false;
}

static PyArrayObject *as_array(PyObject *object, int type, int axes, const char *kernel, const char *name) {
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_Check(object) && PyArray_NDIM(array) == axes && PyArray_ISCARRAY(array) &&
        PyArray_EquivTypenums(PyArray_TYPE(array), type))
        return array;
    PyArray_Descr *descr = PyArray_DescrFromType(type);
    PyErr_Format(PyExc_TypeError, "%s takes as %s a writable, C-contiguous array of %R with %d axes", kernel, name,
                 (PyObject *)descr, axes);
    Py_XDECREF(descr);
    return NULL;
}

static bool as_double(PyObject *object, double *value) {
    *value = PyFloat_AsDouble(object);
    return *value != -1.0 || !PyErr_Occurred();
}

static bool as_integer(PyObject *object, int64_t *value) {
    PyObject *index = PyNumber_Index(object);
    if (index == NULL) return false;
    *value = PyLong_AsLongLong(index);
    Py_DECREF(index);
    return *value != -1 || !PyErr_Occurred();
}

static bool as_truth(PyObject *object, int64_t *value) {
    *value = PyObject_IsTrue(object);
    return *value >= 0;
}

/* --- errors ---------------------------------------------------------------------------------------------------- */

/* The first fields of what a kernel leaves behind that raised: the pickled class and arguments. */
struct raised {
    const char *pickle;
    int32_t size;
};

static PyObject *raise_from(const char *kernel, const struct raised *raised) {
    PyObject *pickle = NULL, *what = NULL;
    if (raised != NULL && (pickle = PyImport_ImportModule("pickle")) != NULL)
        what = PyObject_CallMethod(pickle, "loads", "y#", raised->pickle, (Py_ssize_t)raised->size);
    if (what != NULL && PyTuple_Check(what) && PyTuple_GET_SIZE(what) >= 2)
        PyErr_SetObject(PyTuple_GET_ITEM(what, 0), PyTuple_GET_ITEM(what, 1));
    else if (!PyErr_Occurred())
        PyErr_Format(PyExc_RuntimeError, "%s failed", kernel);
    Py_XDECREF(pickle);
    Py_XDECREF(what);
    return NULL;
}

/* --- numba's runtime: arrays that kernels make for themselves ------------------------------------------------- */

/* Compiled kernels count references in the first field and read `data`; all else is ours. */
struct array_memory {
    size_t references;
    void (*destructor)(void *, size_t, void *);
    void *destructor_info;
    void *data;
    size_t size;
    void *allocator;
};

INTERNAL struct array_memory *NRT_MemInfo_alloc_safe_aligned(size_t size, uint32_t alignment) {
    struct array_memory *memory = malloc(sizeof(*memory) + size + alignment);
    if (memory == NULL) return NULL;
    uintptr_t data = (uintptr_t)(memory + 1);
    memory->references = 1;
    memory->destructor = NULL;
    memory->destructor_info = NULL;
    memory->data = (void *)(data + (alignment - data % alignment) % alignment);
    memory->size = size;
    memory->allocator = NULL;
    return memory;
}

INTERNAL void NRT_MemInfo_call_dtor(struct array_memory *memory) { free(memory); }

INTERNAL void *NRT_Allocate(size_t size) { return malloc(size); }

INTERNAL void NRT_Free(void *memory) { free(memory); }

/* Strides of a reshaped array; numba asks for C-contiguous ones alone, and for 0 where a copy were needed. */
INTERNAL int numba_attempt_nocopy_reshape(
    Py_ssize_t axes, const Py_ssize_t *shape, const Py_ssize_t *strides, Py_ssize_t new_axes,
    const Py_ssize_t *new_shape, Py_ssize_t *new_strides, Py_ssize_t item_size, int fortran_order) {
    Py_ssize_t expected = item_size;
    if (fortran_order) return 0;
    for (Py_ssize_t axis = axes - 1; axis >= 0; axis--) {
        if (shape[axis] != 1 && strides[axis] != expected) return 0;
        expected *= shape[axis];
    }
    expected = item_size;
    for (Py_ssize_t axis = new_axes - 1; axis >= 0; axis--) {
        new_strides[axis] = expected;
        expected *= new_shape[axis];
    }
    return 1;
}

/* --- the module ------------------------------------------------------------------------------------------------ */

struct entry {
    const char *module;
    PyMethodDef method;
};

static bool add_entry(PyObject *kernels, struct entry *entry) {
    PyObject *of_module = PyDict_GetItemString(kernels, entry->module);
    if (of_module == NULL) {
        PyObject *made = PyDict_New();
        if (made == NULL || PyDict_SetItemString(kernels, entry->module, made) < 0) return false;
        Py_DECREF(made);
        of_module = made;
    }
    PyObject *name = PyUnicode_FromString(entry->module);
    PyObject *function = name == NULL ? NULL : PyCFunction_NewEx(&entry->method, NULL, name);
    bool added = function != NULL && PyDict_SetItemString(of_module, entry->method.ml_name, function) == 0;
    Py_XDECREF(name);
    Py_XDECREF(function);
    return added;
}
